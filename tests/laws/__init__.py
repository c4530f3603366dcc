"""Force laws in Python."""
