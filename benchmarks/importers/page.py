"""Renders docs/importers.md from docs/importers.json."""

from __future__ import annotations

from .scenario import POSITION_BOUND

HEAD = """# Importers and checkers

Written by `python -m benchmarks.importers.run` from `docs/importers.json`; `--redraw` writes this page again from the stored
data. Every tool has an environment of its own under `build/importers`, and every run a process of its own.

Each tool runs {scene} for {duration:g} s in steps of {step:g} s: {lift:g} N upward on the top nodes n5 and n6, and a square
wave of {wave:g} N with a period of {period:g} s on n4. The deviation is the largest of any coordinate of any node at any
communication point, from the reference (`tensegrity_core/reference/run.py`) under the same held inputs; up to {bound:g} m
passes. Beside it stands the deviation from the kernel called without FMI: what the tool and the runtime add. Checkers compute
no trajectory.

The FMUs *with simple types* are what `build_fmu.py --simple-types` packs: `solver.method` is an Integer, and the Integer
outputs (`s1.snapped`) are left out. They are run where the others were refused.

| tool | version | runtime | outcome | from reference, m | from kernel, m | remark |
|---|---|---|---|---|---|---|
"""
FOOT = """
Tools count their time differently; the last digits of their step sizes are what the deviations from the kernel show.

Some tools pass a tolerance that nobody chose: OMSimulator always 1e-4, unless it is told another. Followed, it would cost 7e-7
m and 1.1 N where 1e-7 m is promised, so that the FMU takes a tighter tolerance than its own 1e-10 from a host, and no looser
one; it says so in the log and answers `fmi2OK`, since OMSimulator and PyFMI end the run at a warning there. To trade accuracy
for time, set `solver.tolerance` ([what it costs](fmu.md#rules)).

PyFMI's `set_input_derivatives` with the name of a single variable passes order 0, which FMI has not: the FMU refuses it and
goes on. Name the variable in a list.

fmpy's `simulate_fmu` stops early at large start times ([fmu.md](fmu.md#rules)).

A native FMU carries `terminalsAndIcons/terminalsAndIcons.xml` (FMI 3.0's format), with the variables of each node and each
string together. None of these tools minds it.

Where the tool is no Python, as Maestro, the Python FMU finds one by itself (here by `TENSEGRITY_PYTHON`).

How the inputs reach the FMU:

{inputs}

Measured on {machine}.
"""


def render(data: dict) -> str:
    """The page.  data: what run.py stored."""
    scenario, machine = data["scenario"], data["machine"]
    text = HEAD.format(**scenario, bound=POSITION_BOUND)
    for row in data["rows"]:
        gaps = [f"{row[name]:.1e}" if name in row else "" for name in ("deviation", "from_kernel")]
        cells = (row["tool"], row["version"], row["runtime"], row["outcome"], *gaps, remark(row))
        text += f"| {' | '.join(cells)} |\n"
    ways = {row["tool"]: row["inputs"] for row in data["rows"] if row["inputs"]}
    inputs = "\n".join(f"- {tool}: {way}" for tool, way in ways.items())
    where = ", ".join((machine["processor"], machine["system"], f"Python {machine['python']}", f"commit {machine['commit']}"))
    return text + FOOT.format(inputs=inputs, machine=f"{where}, {machine['date']}")


def remark(row: dict) -> str:
    """Why, and the tool's own last words where it said no."""
    said = row["why"].replace("|", "/").replace("<", "&lt;")
    if row["outcome"] in ("refused", "not installed"):
        return f"{row['limit']}: “{said}”" if row["limit"] else f"“{said}”"
    return said
