"""FMUs against the reference, and that what is wrong gets caught."""
