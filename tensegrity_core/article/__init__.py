"""The article's experiments, and their figures."""
