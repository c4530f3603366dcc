"""The subcommand `tensegrity schema`: prints the schema of scene files."""

from __future__ import annotations

import argparse
import sys

from ..scene import schema_text


def schema(arguments: argparse.Namespace) -> int:
    """Print the JSON schema of scene files."""
    sys.stdout.write(schema_text())
    return 0
