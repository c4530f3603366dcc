"""Model exchange in the solvers of importers, beside co-simulation by the kernel."""
