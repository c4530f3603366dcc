"""Runs the article's experiments in full length and writes what docs/experiments.md shows: figures, data, page.

Files: docs/data/experiment_NAME.csv, as `tensegrity experiment NAME` writes it, docs/figures/experiment_NAME_figure_N.png,
docs/experiments.json (the tables, and what they were computed on) and docs/experiments.md.
"""

from __future__ import annotations

import re
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import machine
from benchmarks.harness.page import Page, plain, read_columns, read_json, wrapped, write_json
from tensegrity_core.article.experiments import EXPERIMENTS, SYSTEMS, Wave, system
from tensegrity_core.article.figures import FIGURES
from tensegrity_core.article.figures import style as article_style
from tensegrity_core.output.export import write_columns

from .claims_page import repeats_text
from .measures import repeats

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


def collect() -> dict:
    """Runs everything; what the page tells, and the columns of each experiment."""
    began, where, tables, columns = time.perf_counter(), machine.describe(), {}, {}
    for name in SECTIONS:
        print(name, file=sys.stderr)
        data = EXPERIMENTS[name].run(SYSTEMS, EXPERIMENTS[name].duration)
        tables[name], columns[name] = data.summary().splitlines(), data.columns()
    seconds = round(time.perf_counter() - began)
    return {"machine": where, "seconds": seconds, "tables": tables, "repeats": plain(repeats(), 6), "columns": columns}


def report(data: dict) -> str:
    """docs/experiments.md."""
    where = data["machine"]
    blocks = [
        "# The article's experiments",
        "The experiments of the article's sections III and IV, computed by the kernel and drawn in the article's form. Solid "
        "lines are with NSH, dashed ones without. What they say of the article's statements: [claims.md](claims.md).",
    ]
    for name, (title, text) in SECTIONS.items():
        files = f"Command: `tensegrity experiment {name}`. Data: [CSV](data/experiment_{name}.csv)."
        pictures = [f"![Figure {n}](figures/experiment_{name}_figure_{n}.png)" for n in FIGURES[name]]
        table = "\n".join(["```text", *data["tables"][name], "```"])
        more = {"II": [LARGEST, repeats_text(data)], "III": [LARGEST], "IV": [LARGEST]}.get(name, [])
        blocks += [f"## {title}", text, *pictures, table, *more, files]
    blocks.append(
        f"Computed at commit {where['commit']}, {where['date']}, {where['processor']}, in {data['seconds']} s. Written by "
        "`python -m benchmarks.article.experiments`; `--redraw` writes page and figures again from these files."
    )
    return "\n\n".join(block if block.startswith("```") else wrapped(block) for block in blocks) + "\n"


def keep(data: dict, path: Path) -> None:
    """The columns in CSV files, the rest in a JSON file."""
    for name, columns in data["columns"].items():
        write_columns(columns, path.parent / "data" / f"experiment_{name}.csv")
    write_json({key: value for key, value in data.items() if key != "columns"}, path)


def read(path: Path) -> dict:
    """What `keep` wrote."""
    columns = {name: read_columns(path.parent / "data" / f"experiment_{name}.csv") for name in SECTIONS}
    return read_json(path) | {"columns": columns}


def shown(columns: dict[str, np.ndarray], name: str):
    """An experiment's data as far as its figures read them, from its columns."""
    if name in ("beam", "nsh"):
        return EXPERIMENTS[name].run(SYSTEMS, None)
    parts = dict.fromkeys(key.partition(".")[0] for key in columns if "." in key)

    def of(start: str, end: str) -> np.ndarray:
        return np.array([x for key, x in columns.items() if re.fullmatch(rf"{start}\.{end}", key)]).T

    if name == "I":
        runs = {scene: SimpleNamespace(force=columns["force"], height=of(scene, r"n\d+\.z")) for scene in parts}
    elif name == "II":
        pairs = [key.split(".")[:2] for key in columns if key.endswith("force")]
        runs = dict.fromkeys((scene, float(d[1:])) for scene, d in pairs)
    elif name == "III":
        runs = {scene: (system(scene), None) for scene in parts}
    else:
        known = {scene: (columns["time"], columns[f"{scene}.power"], columns[f"{scene}.absorbed"]) for scene in parts}
        runs = {scene: SimpleNamespace(times=t, power=power, absorbed=x) for scene, (t, power, x) in known.items()}
    return SimpleNamespace(
        runs=runs,
        times=columns.get("time"),
        node=Wave.node,
        displacement=lambda scene, *d: of(".".join((scene, *(f"d{x:g}" for x in d))), r"n\d+\.d[xyz]"),
        string_force=lambda scene, d: of(f"{scene}.d{d:g}", r"s\d+\.elastic_force")[:, 0],
    )


def figure_of(data: dict, name: str, number: int) -> Figure:
    """A figure of the article, in the article's style."""
    with article_style():
        return FIGURES[name][number](shown(data["columns"][name], name))


DRAWN = {
    f"experiment_{name}_figure_{number}": partial(figure_of, name=name, number=number)
    for name, figures in FIGURES.items()
    for number in figures
}
PAGE = Page(__doc__, "experiments", collect, report, DRAWN, keep=keep, read=read)

if __name__ == "__main__":
    PAGE.main()
