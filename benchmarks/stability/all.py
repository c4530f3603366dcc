"""All stability studies, one after the other, in the order of the page.

python -m benchmarks.stability.all [--redraw] [--docs FOLDER]

Measuring takes about 13 minutes of one core; each study prints its own processor time.  All data carry the commit that
stood at the beginning.
"""

from __future__ import annotations

import importlib

from benchmarks.harness import page as common

STUDIES = ("branch_two", "drift", "maps", "fixed_cost", "extremes", "order", "missed", "long_runs")


def main(arguments: list[str] | None = None) -> None:
    chosen = [importlib.import_module(f"benchmarks.stability.{name}").STUDY for name in STUDIES]
    common.studies(chosen, common.command(__doc__).parse_args(arguments))


if __name__ == "__main__":
    main()
