"""The subcommands of `tensegrity`, one module each: options, and what is printed."""
