"""The subcommands of `tensegrity`."""
