"""From a scene to a model in equilibrium."""
