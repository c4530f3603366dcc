"""Scene files, and the scenes of towers."""
