"""What the benchmarks measure, and their pages."""
