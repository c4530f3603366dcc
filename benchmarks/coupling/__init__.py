"""Height control of a tensegrity by coupled FMUs, against the same loop in one."""
