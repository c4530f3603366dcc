"""Steady states: followed along a path, swept by a load, and the small motions about them."""
