"""FMUs from tensegrity models: interface, description, packing, the runtime inside, validation from outside."""
