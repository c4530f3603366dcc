"""All stability studies, one after the other, in the order of the page.

python -m benchmarks.stability.all [--redraw] [--docs FOLDER]

Measuring takes about 13 minutes of one core; each study prints its own processor time.  All data carry the commit that
stood at the beginning.
"""

from __future__ import annotations

import importlib

from benchmarks.harness import page as common

STUDIES = ("branch_two", "drift", "maps", "fixed_cost", "extremes", "order", "missed", "long_runs")


def main() -> None:
    chosen, begun = common.arguments(__doc__), common.processor_seconds()
    for name in STUDIES:
        study = importlib.import_module(f"benchmarks.stability.{name}")
        common.carry_out(name, study.measure, study.draw, study.section, chosen)
    print(f"all: {common.processor_seconds() - begun:.0f} s")


if __name__ == "__main__":
    main()
