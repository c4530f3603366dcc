"""The C kernel through its binding."""
