"""Model exchange by CVODE over 5 s of the article's inputs: all six scenes against the reference.

``python -m benchmarks.exchange.promise`` measures this table alone, puts it into docs/model_exchange.json and writes the page
again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import DOCS, plain, read_json, write_json
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.validation.scenarios import Scenario, scenarios
from fmu_src.validation.validate import run_outside
from tensegrity_core import reference
from tensegrity_core.files import scratch
from tensegrity_core.model import Model, Transition
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model

#: Names of runs at the scenes' damping end so, and at a tenth of it: d = 500 and 50 N s/m.
ENDINGS = ("_1d",)
#: Times of transitions may differ by as much, s.
APART = 1e-6


def collect(folder: Path) -> dict:
    """The table, and what it was measured on."""
    return {"promise_machine": machine.describe(), "promise": rows(folder)}


def rows(folder: Path) -> list[dict]:
    found = []
    for name in builtin_scenes():
        model = build_model(load_scene(name))
        fmu = pack_native_fmu(model, folder / f"{name}_promise.fmu", kind="me")
        for run in scenarios(model):
            if run.name.endswith(ENDINGS):
                found.append({"scene": name, "run": run.short} | one(model, fmu, run))
                print(found[-1], flush=True)
    return found


def one(model: Model, fmu: Path, run: Scenario) -> dict:
    """Largest error of a position, m; of a length, relative; transitions, and whether each string went through the same."""
    ((outputs, events, _),) = run_outside(fmu, model, runs=[run], kind="me")
    right = reference.simulate(run.model, run.inputs)
    ends = outputs["position"][:, model.bars]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) / model.bar_length - 1.0
    return {
        "error": float(np.abs(outputs["position"] - right.position).max()),
        "length": float(np.abs(lengths).max()),
        "transitions": len(right.transitions),
        "same": same(events, list(right.transitions)),
    }


def same(ours: list[Transition], theirs: list[Transition]) -> bool:
    """String by string: those of symmetric strings at one instant come in any order."""
    for string in {t.string for t in (*ours, *theirs)}:
        a, b = ([t for t in each if t.string == string] for each in (ours, theirs))
        if [(t.before, t.after) for t in a] != [(t.before, t.after) for t in b]:
            return False
        if any(abs(s.time - t.time) > APART for s, t in zip(a, b)):
            return False
    return True


def main() -> None:
    from . import run  # which needs this module

    with scratch() as folder:
        found = plain(collect(folder), 4)
    path = DOCS / f"{run.PAGE.name}.json"
    write_json(read_json(path) | found, path)
    run.PAGE.redraw()


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
