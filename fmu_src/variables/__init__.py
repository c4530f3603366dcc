"""The table of an FMU's variables, and what is rendered from it: description, terminals, documentation, icon."""
