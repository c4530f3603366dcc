"""Runs an SSP in tools with masters of their own, each in its environment under build/importers."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fmpy import extract, read_model_description

from benchmarks.importers import environments
from benchmarks.importers.tools import TOOLS
from fmu_src.packing.ssp import PARAMETERS
from tensegrity_core.files import scratch, write_text

from .system import Plan

BASE = Path(__file__).resolve().parents[2] / "build" / "importers"
DRIVERS = Path(__file__).resolve().parent / "drivers"
#: Wall time of a run, s.
LIMIT = 300.0
#: Driver -> the importer whose environment it runs in.
OF = {"libcosim": "libcosim (libcosimpy)", "ecos": "ecos (ecospy)"}


class Refused(Exception):
    """A tool that cannot be had, or did not run the SSP; the text says why."""


class Tool(NamedTuple):
    """python: of its environment; libraries: a folder for the loader, or None."""

    driver: str
    version: str
    python: Path
    libraries: Path | None


def tool(driver: str) -> Tool:
    """Raises Refused where it cannot be had."""
    entry = next(one for one in TOOLS if one.name == OF[driver])
    try:
        python = environments.python_of(entry, BASE)
        return Tool(driver, environments.version_of(entry, python), python, environments.libraries_of(entry, BASE))
    except environments.Missing as missing:
        raise Refused(str(missing)) from missing


def run(one: Tool, ssp: Path, plan: Plan, structure: Path, h: float, steps: int) -> np.ndarray:
    """(K, 3) m: the controlled heights after each communication step.  structure: its FMU.  Raises Refused."""
    (unit,) = {name for name, _ in plan.heights}
    outputs = [output for _, output in plan.heights]
    known = {variable.name: variable.valueReference for variable in read_model_description(str(structure)).modelVariables}
    with scratch() as folder:
        told = {
            "ssp": str(ssp),
            "folder": str(extract(str(ssp), str(folder / "ssp"))),
            "step": h,
            "steps": steps,
            "parameters": PARAMETERS,
            "unit": unit,
            "outputs": outputs,
            "references": [known[output] for output in outputs],
        }
        write_text(folder / "job.json", json.dumps(told))
        command = [str(one.python), str(DRIVERS / f"{one.driver}.py"), str(folder / "job.json"), str(folder / "result.json")]
        surroundings = os.environ | ({"LD_LIBRARY_PATH": str(one.libraries)} if one.libraries else {})
        try:
            done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=LIMIT)
        except subprocess.TimeoutExpired:
            raise Refused(f"did not end within {LIMIT:g} s") from None
        if not (folder / "result.json").is_file():
            raise Refused(f"{environments.last_words(done.stdout + done.stderr)} (exit code {done.returncode})")
        return np.array(json.loads((folder / "result.json").read_text(encoding="utf-8")))
