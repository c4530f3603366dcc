"""Runs the article's experiments in full length and writes what docs/experiments.md shows: figures, data, page.

Files: docs/figures/experiment_NAME.csv and experiment_NAME_figure_N.png and .svg, as `tensegrity experiment NAME` writes them,
docs/experiments.json (the tables, and what they were computed on) and docs/experiments.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from benchmarks.harness import machine
from benchmarks.harness.page import plain, wrapped
from tensegrity_core.article.experiments import EXPERIMENTS, SYSTEMS
from tensegrity_core.article.figures import FIGURES, write_figures
from tensegrity_core.files import write_text
from tensegrity_core.output.export import write_columns

from .claims_page import repeats_text
from .measures import repeats

ROOT = Path(__file__).resolve().parent.parent.parent
#: Experiment -> title and what is done.
SECTIONS = {
    "beam": (
        "Figure 3: a beam",
        "The force of a single negative stiffness beam over its displacement (eq. 11), with the extrema of eq. 14.",
    ),
    "nsh": (
        "Figure 5: the honeycomb",
        "Algorithm 1, exactly: forces are equal, displacements add up; while a beam snaps the others are held.",
    ),
    "I": (
        "I: steady heights",
        "Every top node is pulled up by a constant force, each of 10, 12 ... 72 N in a run of its own; after 50 s the heights "
        "are read off. With NSH the curves jump where a beam snaps.",
    ),
    "II": (
        "II: square wave",
        "The three-bar system under a vertical force on n4 of +400 N for half a second, then -400 N for the other half. The "
        "article does not say with which sign it starts.",
    ),
    "III": (
        "III: actuated strings",
        "The rest lengths of the top strings move by 0.15 m as a sine of 2.5 s from t = 2 s on; shown is the last node's "
        "displacement from its place at the start. Between communication points, 10 ms apart, rest lengths move with constant "
        "rates, which the dampers see.",
    ),
    "IV": (
        "IV: one dimension",
        "A mass on one spring and damper, 100 N in the first half of every second. The article gives no mass, stiffness or "
        "damping: 1 kg, 5000 N/m and 500 N s/m are those of a bar and a string of its 3D systems. Power is velocity times "
        "external force; its integral is the absorbed energy, part of which is still stored at the end.",
    ),
}


LARGEST = "Largest values, and swings, are those of the motion, not of the samples that figures and CSV file show."


def collect(folder: Path) -> dict:
    """Runs everything, writes data and figures to a folder, and returns what the page tells."""
    began, where, tables = time.perf_counter(), machine.describe(), {}
    for name in SECTIONS:
        print(name, file=sys.stderr)
        experiment = EXPERIMENTS[name]
        data = experiment.run(SYSTEMS, experiment.duration)
        stem = folder / f"experiment_{name}"
        write_columns(data.columns(), stem.with_suffix(".csv"))
        write_figures(name, data, stem)
        tables[name] = data.summary().splitlines()
    return {"machine": where, "seconds": round(time.perf_counter() - began), "tables": tables, "repeats": plain(repeats(), 6)}


def report(data: dict) -> str:
    """docs/experiments.md."""
    where = data["machine"]
    blocks = [
        "# The article's experiments",
        "The experiments of the article's sections III and IV, computed by the kernel and drawn in the article's form. Solid "
        "lines are with NSH, dashed ones without. What they say of the article's statements: [claims.md](claims.md).",
    ]
    for name, (title, text) in SECTIONS.items():
        files = f"Command: `tensegrity experiment {name}`. Data: [CSV](figures/experiment_{name}.csv)."
        pictures = [f"![Figure {n}](figures/experiment_{name}_figure_{n}.png)" for n in FIGURES[name]]
        table = "\n".join(["```text", *data["tables"][name], "```"])
        more = {"II": [LARGEST, repeats_text(data)], "III": [LARGEST], "IV": [LARGEST]}.get(name, [])
        blocks += [f"## {title}", text, *pictures, table, *more, files]
    blocks.append(
        f"Computed at commit {where['commit']}, {where['date']}, {where['processor']}, in {data['seconds']} s. Written by "
        "`python -m benchmarks.article.experiments`; each PNG has an SVG beside it."
    )
    return "\n\n".join(block if block.startswith("```") else wrapped(block) for block in blocks) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--redraw", action="store_true", help="write the page again from experiments.json, without computing")
    options = parser.parse_args()
    path = options.output / "experiments.json"
    if options.redraw:
        data = json.loads(path.read_text(encoding="utf-8"))
    else:
        (options.output / "figures").mkdir(parents=True, exist_ok=True)
        data = collect(options.output / "figures")
        write_text(path, json.dumps(data, indent=1) + "\n")
    write_text(options.output / "experiments.md", report(data))


if __name__ == "__main__":
    main()
