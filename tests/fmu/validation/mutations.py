"""FMUs that are wrong by 1e-5 in one law: every parameter of a model in turn, and places of the C sources that no parameter
reaches.  The kernel stands in for the FMU and, at a tolerance of 1e-13, for the reference (they agree, see test_trials.py).

All of them for every scene of the tests: `python -m tests.fmu.validation.mutations`; for some: with their names.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fmu_src.validation.compare import COUNTED, Comparison, compare
from fmu_src.validation.scenarios import Scenario
from fmu_src.validation.sensitivity import OUTPUTS, Spread, spreads
from fmu_src.validation.trials import trials
from fmu_src.validation.validate import START_ERROR, TIGHT
from tensegrity_core import kernel
from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import binding
from tensegrity_core.laws import string_law
from tensegrity_core.model import Model, Result
from tensegrity_core.native import build
from tensegrity_core.scene import builtin_scenes
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, built
from tests.support.driven_scenes import MAST as WOUND
from tests.support.element_scenes import STRINGS, mast
from tests.support.words import words

#: By how much a law is wrong.
PART = 1e-5
SCENES = {name: lambda name=name: scene(name) for name in builtin_scenes()}
SCENES |= {f"mast_{name}": lambda name=name: mast(name) for name in STRINGS}
SCENES |= {"laboratory": lambda: built(LABORATORY), "wound": lambda: built(WOUND)}


class Trial(NamedTuple):
    """A scenario with what it is judged by."""

    run: Scenario
    right: Result
    allowed: Spread


def prepared(model: Model) -> list[Trial]:
    """The trials of a model."""
    return [
        Trial(run, kernel.simulate(run.model, run.inputs, tolerance=1e-13), spreads(run.model, run.inputs, START_ERROR)[0])
        for run in trials(model)
    ]


def as_fmu(result: Result) -> dict[str, np.ndarray]:
    """What compare.series makes of an FMU's outputs."""
    return {name: getattr(result, name) for name in (*OUTPUTS, "throughput", *COUNTED)}


def judged(trial: Trial, found: Result) -> Comparison:
    longest = float(np.max(trial.run.model.bar_length, initial=0.0))
    return compare(trial.right, as_fmu(found), found.transitions, trial.allowed, longest, TIGHT[0])


def caught(ready: list[Trial], wrong_run) -> str | None:
    """The first trial in which a wrong run, wrong_run(scenario) -> Result, fails at every tight tolerance; None: in none."""
    for trial in ready:
        if all(_fails(trial, wrong_run, tolerance) for tolerance in TIGHT):
            return trial.run.name
    return None


def _fails(trial: Trial, wrong_run, tolerance: float) -> bool:
    try:
        return bool(judged(trial, wrong_run(trial.run, tolerance)).failures)
    except TensegrityError:  # refused, or it cannot go on where the right run does
        return True


# Parameters


def parameters(model: Model):
    """(name, model -> model with that parameter wrong by a factor) of every parameter that is not zero."""
    for name in ("stiffness", "damping", "bar_mass"):
        for i, value in enumerate(getattr(model, name)):
            needless = name == "stiffness" and i in model.elements and not string_law(model, i).uses_stiffness
            if value and not needless:
                yield f"{name}[{i}]", partial(_with_one_of, name, i)
    for i in range(np.size(model.gravity)):
        if np.ravel(model.gravity)[i]:
            yield f"gravity[{i}]", partial(_with_gravity, i)
    for name in ("point_mass", "drag"):
        for i in range(len(getattr(model, name))):
            yield f"{name}[{i}]", partial(_with_one_of_pairs, name, i)
    for name in ("nsh", "element", "damper", "actuator"):
        for j, one in enumerate(getattr(model, name)):
            for path in numbers(one):
                yield f"{name}[{j}].{'.'.join(map(str, path))}", partial(_with_number, name, j, path)


def _scaled(values, i, factor):
    found = np.array(values)
    found[i] *= factor
    return found


def _with_one_of(name, i, model, factor):
    return replace(model, **{name: _scaled(getattr(model, name), i, factor)})


def _with_gravity(i, model, factor):
    one = np.ndim(model.gravity) == 0
    return replace(model, gravity=model.gravity * factor if one else tuple(_scaled(model.gravity, i, factor).tolist()))


def _with_one_of_pairs(name, i, model, factor):
    table = enumerate(getattr(model, name))
    return replace(model, **{name: tuple((node, value * factor if at == i else value) for at, (node, value) in table)})


def _with_number(name, j, path, model, factor):
    values = enumerate(getattr(model, name))
    return replace(model, **{name: tuple(_deep(value, path, factor) if at == j else value for at, value in values)})


def numbers(one) -> list[tuple]:
    """Paths to the floats, other than 0, in dataclasses and tuples."""
    if isinstance(one, float):
        return [()] if one else []
    inside = enumerate(one) if isinstance(one, tuple) else ()
    if is_dataclass(one):
        inside = ((field.name, getattr(one, field.name)) for field in fields(one))
    return [(key, *path) for key, value in inside for path in numbers(value)]


def _deep(one, path, factor):
    if not path:
        return one * factor
    if isinstance(one, tuple):
        return tuple(_deep(value, path[1:], factor) if at == path[0] else value for at, value in enumerate(one))
    return replace(one, **{path[0]: _deep(getattr(one, path[0]), path[1:], factor)})


# Sources

#: Name: file, what stands there, what is wrong instead, and a scene that has it.
SOURCES = tomllib.loads(Path(__file__).with_name("wrong_sources.toml").read_text(encoding="utf-8"))


def compiled(folder: Path) -> Path:
    """A folder with the kernel's sources and their objects, compiled for a short time of compilation."""
    for path in build.reads("kernel"):
        if path.suffix in build.SOURCES:
            target = folder / path.relative_to(build.HERE)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)
    _compile(folder, [path.relative_to(build.HERE).as_posix() for path in build.kernel_sources()])
    return folder


def _compile(folder: Path, names: list[str]) -> None:
    options = ["-std=c99", "-O1", "-fPIC", "-fvisibility=hidden", "-DTS_EXPORTED", "-I.", "-c"]
    subprocess.run([*(build.system_compiler() or build.zig()), *options, *names], cwd=folder, check=True)


def mutated_library(folder: Path, name: str | None, right: Path) -> Path:
    """The kernel with one of SOURCES, or as it is, linked into a folder.  right: from `compiled`."""
    shutil.copytree(right, folder)
    if name is not None:
        file, there, wrong = (SOURCES[name][key] for key in ("file", "there", "wrong"))
        text = (folder / file).read_text(encoding="utf-8")
        assert there in text, f"{file} has no {there!r} any more"
        (folder / file).write_text(text.replace(there, wrong), encoding="utf-8")
        _compile(folder, [file] if file.endswith(".c") else [f"{file.split('_')[0]}.c"])
    command = [*(build.system_compiler() or build.zig()), "-shared"]
    objects = sorted(path.name for path in folder.glob("*.o"))
    subprocess.run([*command, *objects, "-lm", "-o", build.LIBRARY], cwd=folder, check=True)
    return folder / build.LIBRARY


def with_library(library: Path):
    """wrong_run for `caught`, with another library."""
    usual = binding.load_library

    def run(one: Scenario, tolerance: float) -> Result:
        binding.load_library = lambda path=None: usual(library)
        try:
            return kernel.simulate(one.model, one.inputs, tolerance=tolerance)
        finally:
            binding.load_library = usual

    return run


def missed(model: Model, ready: list[Trial], chosen=lambda i: True) -> tuple[int, list[str]]:
    """How many parameters were tried, each with both signs, and those that were not caught.  chosen: of their numbers."""
    found, count = [], 0
    for i, (name, wrong) in enumerate(parameters(model)):
        for factor in (1.0 + PART, 1.0 - PART) if chosen(i) else ():
            count += 1

            def run(one: Scenario, tolerance: float, wrong=wrong, factor=factor) -> Result:
                return kernel.simulate(wrong(one.model, factor), one.inputs, tolerance=tolerance)

            if caught(ready, run) is None:
                found.append(f"{name} * {factor}")
    return count, found


def main(names: list[str]) -> int:
    """Every parameter of the scenes with these names, or of all; then, for all, the sources."""
    bad, total, began = 0, 0, time.process_time()
    for name in names or SCENES:
        model = SCENES[name]()
        count, found = missed(model, prepared(model))
        bad, total = bad + len(found), total + count
        print(f"{name}: {count} wrong parameters, missed: {', '.join(found) or 'none'}", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        right = compiled(Path(scratch) / "right")
        for name in () if names else SOURCES:
            library = mutated_library(Path(scratch) / name, name, right)
            by = caught(prepared(SCENES[SOURCES[name]["scene"]]()), with_library(library))
            bad, total = bad + (by is None), total + 1
            print(f"source, {name}: {'missed' if by is None else f'caught by {by}'}", flush=True)
    print(f"{total - bad} of {total} caught, {time.process_time() - began:.0f} s")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(*words(__doc__, names=[])))
