"""Draws all figures and writes all pages again, from the data in docs/: python -m benchmarks.redraw [WORD ...]

Without words all, else those whose names have one of the words.  It takes a minute, and measures nothing.
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from benchmarks.harness.page import DOCS, Page, Study
from benchmarks.stability.all import STUDIES

PAGES = (
    "article.claims_page",
    "article.equilibrium_paths",
    "article.experiments",
    "article.memory",
    "coupling.run",
    "exchange.run",
    "ground.run",
    "importers.run",
    "speed.fmu_speed",
    "speed.growth",
    "speed.method_choice",
    "speed.real_time",
    "speed.scene_costs",
    "speed.speed",
    "speed.unused_parts",
    "work_precision.run",
)


def pages() -> list[Page]:
    return [importlib.import_module(f"benchmarks.{name}").PAGE for name in PAGES]


def studies() -> list[Study]:
    return [importlib.import_module(f"benchmarks.stability.{name}").STUDY for name in STUDIES]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", metavar="WORD")
    parser.add_argument("--docs", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    for one in (*pages(), *studies()):
        if not options.words or any(word in one.name for word in options.words):
            print(one.name, flush=True)
            one.redraw(options.docs)


if __name__ == "__main__":
    main()
