"""The article's experiments."""
