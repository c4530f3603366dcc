"""The subcommand `tensegrity schema`: prints the schema of scene files."""

from __future__ import annotations

import sys

from .options import Debug


def schema(debug: Debug = False) -> None:
    """Print the JSON schema of scene files, for editors that complete and check them."""
    from ..scene import schema_text

    sys.stdout.write(schema_text())
