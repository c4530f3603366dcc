"""Time and work: of the kernel, of FMUs, of scenes, against size, and of the choice of method."""
