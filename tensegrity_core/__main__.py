"""The program `tensegrity`, also as python -m tensegrity_core."""

from __future__ import annotations

from typing import NoReturn

from .interrupts import program


def main() -> NoReturn:
    """Run the command; what it needs is loaded where Ctrl-C ends it quietly."""

    def run() -> int:
        from .cli import main

        return main()

    program(run)


if __name__ == "__main__":
    main()
