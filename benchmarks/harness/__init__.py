"""What benchmarks share: problems, the machine, figures and pages."""
