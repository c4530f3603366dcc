"""The article's experiments and claims, measured."""
