"""Steady states, followed, swept and linearised."""
