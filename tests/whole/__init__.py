"""What spans rooms: the documentation, the wheel, who imports whom, files, interrupts, all solvers at once."""
