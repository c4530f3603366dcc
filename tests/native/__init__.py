"""The C sources by themselves."""
