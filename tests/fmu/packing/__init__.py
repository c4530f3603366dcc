"""What is in an FMU, for every platform."""
