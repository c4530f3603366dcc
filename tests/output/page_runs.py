"""The page's kernel under node, beside the library's: for the tests, and `python -m tests.output.page_runs [SECONDS]`, which
prints the largest difference of every output over all scenes and methods."""

from __future__ import annotations

import base64
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tensegrity_core.fields import FIELDS, METHODS, STATS
from tensegrity_core.kernel import Kernel, input_rows, simulate, to_bytes
from tensegrity_core.model import Model, Result
from tensegrity_core.model.components import flattened, present
from tensegrity_core.output.page import bundle
from tensegrity_core.output.page.made import folder_of_parts
from tensegrity_core.scene import builtin_scenes
from tests.support import scene
from tests.support.recorded import OPTIONS, history
from tests.support.words import words

RUNNER = Path(__file__).with_name("page_kernel.mjs")


class Run(NamedTuple):
    """One scene under one method: the library's result, and what the page's kernel gave.

    values: (K+1, outputs) of the page's kernel by field; told: transitions, snapped, restored, stats, time, refused.
    """

    model: Model
    method: str
    native: Result
    values: dict[str, np.ndarray]
    told: dict[str, Any]


def job(model: Model, kernel: Kernel, rows: np.ndarray, times: np.ndarray, **options) -> dict[str, Any]:
    """What page_kernel.mjs is given of a run."""
    return {
        "packed": base64.b64encode(to_bytes(model)).decode(),
        "fields": {name: [at.start, at.stop] for name, at in kernel.layout.items()},
        "integers": {name: [at.start, at.stop] for name, at in kernel.integer_layout.items()},
        "rows": rows.tolist(),
        "steps": np.diff(times).tolist(),
        "start": float(times[0]),
        "stats": len(STATS),
        "method": METHODS.index(options["method"]),
        "tolerance": options["tolerance"],
        "max_step": options["max_step"],
    }


def under_node(jobs: list[dict[str, Any]], folder: Path) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """All values of all runs, one after the other, and what else there is to tell of each."""
    (folder / "jobs.json").write_text(json.dumps(jobs), encoding="utf-8")
    node, _ = bundle.node()
    module = folder_of_parts() / bundle.KERNEL
    words = [str(path) for path in (RUNNER, bundle.WEB / "kernel.js", module, folder / "jobs.json", folder / "values.bin")]
    done = subprocess.run([*node, *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return np.fromfile(folder / "values.bin"), json.loads(done.stdout)


def side_by_side(models: list[Model], seconds: float, folder: Path, tolerance: float = 1e-10) -> list[Run]:
    """Every model under every method with moving inputs, by both kernels."""
    jobs, runs = [], []
    for model in models:
        inputs = history(model, seconds)
        rows = input_rows(model, inputs)
        for method in METHODS:
            options = {"method": method, "tolerance": tolerance, "max_step": OPTIONS.get(method, {}).get("max_step", 0.0)}
            kernel = Kernel(model, **options)
            jobs.append(job(model, kernel, rows, inputs.times, **options))
            runs.append((model, method, kernel, simulate(model, inputs, **options)))
    values, told = under_node(jobs, folder)
    found, at = [], 0
    for (model, method, kernel, native), answer in zip(runs, told, strict=True):
        count = len(native.times) * len(kernel.values)
        rows = values[at : at + count].reshape(len(native.times), -1)
        at += count
        series = {field.name: rows[:, kernel.layout[field.name]] for field in FIELDS if field.role == "output"}
        found.append(Run(model, method, native, series, answer))
    assert at == len(values)
    return found


def differences(run: Run) -> dict[str, float]:
    """Largest difference of each output, in its unit, over the values that are variables."""
    found = {}
    for field in FIELDS:
        if field.role == "output" and run.values[field.name].size:
            known = run.native.outputs[field.name]
            known = flattened(field, run.model, known) if field.shape else known[:, None]
            off = np.abs(run.values[field.name] - known)[:, present(field, run.model)]
            found[field.name] = float(np.max(off, initial=0.0))
    return found


def main() -> None:
    (seconds,) = words(__doc__, seconds=1.0)
    with tempfile.TemporaryDirectory() as folder:
        runs = side_by_side([scene(name) for name in builtin_scenes()], seconds, Path(folder))
    for run in runs:
        shown = ", ".join(f"{name} {size:.1e}" for name, size in differences(run).items() if size)
        print(f"{run.model.name:14} {run.method:8} {shown or 'the same to the last bit'}")


if __name__ == "__main__":
    main()
