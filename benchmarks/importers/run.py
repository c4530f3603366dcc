"""Run both FMUs in every importer: ``python -m benchmarks.importers.run`` writes docs/importers.json and docs/importers.md.

Needs the network (PyPI, and for some tools Maven Central or Debian) at the first call, some minutes; environments stay in
build/importers.  A tool that cannot be installed, or that refuses an FMU, is a row and no failure.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import Page, rendered
from benchmarks.harness.page import command as command_line
from tensegrity_core.files import scratch, write_text
from tensegrity_core.model import Model

from . import environments, scenario
from .tools import COUPLED, ME, THREE, THREE_ME, TOOLS, Tool

ROOT = Path(__file__).resolve().parent.parent.parent
BASE = ROOT / "build" / "importers"
DRIVERS = Path(__file__).resolve().parent / "drivers"
#: Native FMUs by standard and kind.
KINDS = ("native", ME, THREE, THREE_ME)
#: Wall time of one run, s.
LIMIT = 300.0


class Expected(NamedTuple):
    """(K+1, N, 3) positions, m, of the reference and of the kernel."""

    model: Model
    reference: np.ndarray
    kernel: np.ndarray


def one(tool: Tool, fmu: Path, source: Path, expected: Expected) -> dict:
    """A run of one FMU in one tool, as a row: outcome 'passed', 'refused', 'differs', 'not installed' or 'not run', and why."""
    try:
        python = environments.python_of(tool, BASE)
        program, libraries = environments.program_of(tool, BASE), environments.libraries_of(tool, BASE)
        version = environments.version_of(tool, python)
    except environments.Missing as missing:
        return {"version": "", "outcome": "not installed", "why": str(missing)}
    if tool.driver is None:
        return {"version": version, "outcome": "not run", "why": "it can be installed, but has no driver here yet"}
    with scratch() as folder:
        told = scenario.job(expected.model, fmu, source, folder) | {"program": str(program), "coupled": tool.inputs == COUPLED}
        write_text(folder / "job.json", json.dumps(told))
        command = [str(python), str(DRIVERS / f"{tool.driver}.py"), str(folder / "job.json"), str(folder / "result.json")]
        return {"version": version, **outcome(command, folder, libraries, expected)}


def outcome(command: list[str], folder: Path, libraries: Path | None, expected: Expected) -> dict:
    """Run a driver and judge what it wrote; libraries: a folder for the loader."""
    surroundings = {**os.environ, "TENSEGRITY_PYTHON": sys.executable}  # for hosts without Python
    surroundings |= {"LD_LIBRARY_PATH": str(libraries)} if libraries else {}
    try:
        done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return {"outcome": "refused", "why": f"did not end within {LIMIT:g} s"}
    said = environments.last_words(done.stdout + done.stderr)
    result = folder / "result.json"
    if not result.is_file():
        died = f"killed by signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        return {"outcome": "refused", "why": f"{said} ({died})"}
    after = f"the process ended with {done.returncode} after a complete run: {said}" if done.returncode else ""
    return judged(json.loads(result.read_text(encoding="utf-8")), expected, after)


def judged(found: dict, expected: Expected, after: str) -> dict:
    """Outcome of a run; found: see drivers/job.py; after: what happened once it was over."""
    if not found["rows"]:
        return {"outcome": "passed", "why": after or found["note"]}
    axes, theirs = list(expected.model.axes), np.array(found["rows"])
    ours = [positions[found["first"] :, :, axes] for positions in (expected.reference, expected.kernel)]
    if theirs.size != ours[0].size:
        return {"outcome": "differs", "why": f"{len(theirs)} rows of {theirs.shape[1]} outputs, not {len(ours[0])}"}
    gap, added = (float(np.max(np.abs(theirs.reshape(one.shape) - one))) for one in ours)
    verdict = "passed" if gap <= scenario.POSITION_BOUND else "differs"
    return {"outcome": verdict, "why": after or found["note"], "deviation": gap, "from_kernel": added}


def measure(chosen: list[Tool]) -> list[dict]:
    """All rows; prints each."""
    model = scenario.model()
    source = scenario.pack_source(BASE / "fmus" / "square_wave.fmu")
    folders = {name: BASE / "fmus" / name.replace(", ", "-").replace(" ", "-") for name in scenario.PACK}
    fmus = {name: pack(model, folders[name] / f"{model.name}.fmu") for name, pack in scenario.PACK.items()}
    expected, rows = Expected(model, scenario.expected(model), scenario.plain_kernel(model)), []
    for tool in chosen:
        refused = set()
        for runtime, fmu in fmus.items():
            simple = runtime in map(scenario.SIMPLE, scenario.PACK)
            if runtime not in (map(scenario.SIMPLE, refused) if simple else tool.fmus):
                continue
            row = {"tool": tool.name, "runtime": runtime, "inputs": tool.inputs, "limit": tool.why_not(runtime)}
            row |= one(tool, fmu, source, expected)
            rows.append(row)
            refused |= {runtime} if row["outcome"] == "refused" else set()
            print(f"{row['tool']:<42}{runtime:<23}{row['outcome']:<14}{row.get('deviation', '')} {row['why']}", flush=True)
    return rows


def collect() -> dict:
    return {"machine": machine.describe(), "scenario": scenario.SHOWN, "rows": measure(TOOLS)}


def report(data: dict) -> str:
    """docs/importers.md."""
    ways = {row["tool"]: row["inputs"] for row in data["rows"] if row["inputs"]}
    found = {"bound": scenario.POSITION_BOUND, "ways": ways, "remark": remark, "matrix": matrix(data["rows"])}
    return rendered("importers/page", **data, **found)


def matrix(rows: list[dict]) -> dict[str, list[str]]:
    """By tool that was there: how the native FMUs of each standard and kind fared."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if row["outcome"] not in ("not installed", "not run"):
            found.setdefault(row["tool"], ["–"] * len(KINDS))
            runtime = row["runtime"].removesuffix(", simple types")
            if runtime in KINDS and found[row["tool"]][KINDS.index(runtime)] in ("–", "refused"):
                deviation = f"{row['deviation']:.1e} m" if row.get("deviation") is not None else ""
                simple = ", simple types" if runtime != row["runtime"] else ""
                shown = (deviation or "passed") if row["outcome"] == "passed" else f"{row['outcome']} {deviation}".strip()
                found[row["tool"]][KINDS.index(runtime)] = shown + simple
    return found


def remark(row: dict) -> str:
    """Why, and the tool's own last words where it said no."""
    said = row["why"].replace("|", "/").replace("<", "&lt;")
    if row["outcome"] in ("refused", "not installed"):
        return f"{row['limit']}: “{said}”" if row["limit"] else f"“{said}”"
    return row["limit"] if row["outcome"] == "differs" else said


PAGE = Page(__doc__, "importers", collect, report)


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only tools whose names have one of these words; writes nothing"
    )
    options = parser.parse_args()
    if options.words:
        measure([tool for tool in TOOLS if any(word in tool.name for word in options.words)])
    else:
        PAGE.write(options.docs, options.redraw)


if __name__ == "__main__":
    main()
