"""Both kinds of FMU, call by call."""
