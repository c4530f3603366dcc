"""Other people's importers of FMUs run ours: one scenario, both runtimes, every tool that the machine can have."""
