"""The program `tensegrity`, also as python -m tensegrity_core."""

from __future__ import annotations

import sys

from .interrupts import interruptible


def main() -> int:
    """Run the command; what it needs is loaded where Ctrl-C ends it quietly."""

    def run() -> int:
        from .cli import main

        return main()

    return interruptible(run)


if __name__ == "__main__":
    sys.exit(main())
