"""The words behind ``python -m tests....``, for scripts that take a few and no options."""

from __future__ import annotations

import argparse
from typing import Any


def words(about: str | None, *kinds: type, **wanted: Any) -> list[Any]:
    """The words, as the script's docstring about them tells.  --help shows that and ends; so does a word that will not do.

    kinds: of each word that must be there; wanted: name -> what a word is that may be left out, in order; of a list, the rest.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for number, kind in enumerate(kinds):
        parser.add_argument(f"word{number}", type=kind, metavar={int: "COUNT", str: "WORD"}.get(kind, kind.__name__.upper()))
    for name, start in wanted.items():
        many = isinstance(start, list)
        parser.add_argument(
            name, type=str if many else type(start), metavar=name.upper(), nargs="*" if many else "?", default=start
        )
    return list(vars(parser.parse_args()).values())
