"""Work against precision, for every method and for other solvers."""
