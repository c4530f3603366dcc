"""FMUs: their variables, packing, validation, and what both runtimes answer."""
