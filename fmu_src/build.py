"""Builds FMUs of tensegrity scenes and validates them against the reference: python -m fmu_src.build three_bar_nsh"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

from tensegrity_core.commands.common import Parser
from tensegrity_core.errors import TensegrityError, shown
from tensegrity_core.interrupts import program
from tensegrity_core.model import Model
from tensegrity_core.native.build import TARGETS
from tensegrity_core.scene import Scene, builtin_scenes, load_scene
from tensegrity_core.statics import build_model

from .packing.actuator import detached
from .packing.libraries import cross_compiled, here
from .packing.native_fmu import pack_native_fmu
from .packing.pack import pack_python_fmu
from .validation.cross_check import write_cross_check
from .validation.reference_cache import trouble
from .validation.report import write_report
from .validation.scenarios import Scenario, scenarios
from .validation.trials import trials
from .validation.validate import CACHE, Validation, finish, repeated, run_outside, submit, workers


def command_name() -> str:
    """How the command was called."""
    return "python -m fmu_src.build" if Path(sys.argv[0]).name == "build.py" else "build_fmu.py"


def arguments(words: list[str] | None) -> argparse.Namespace:
    parser = Parser(prog=command_name(), description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="a scene's name, or the path of a .toml file")
    parser.add_argument("--all", action="store_true", help=f"all scenes: {', '.join(builtin_scenes())}")
    parser.add_argument("--runtime", choices=("python", "native", "both"), default="both", help="default: both")
    targets = f"{', '.join(TARGETS)}, or all"
    asked: dict[str, Any] = {"type": platforms, "default": (), "metavar": "NAMES"}
    parser.add_argument("--platforms", **asked, help=f"beside this one: {targets}")
    parser.add_argument("--sources", action="store_true", help="native FMUs that can be compiled from their sources, too")
    simple = "FMUs with Real outputs and no enumeration, for tools that know no others"
    parser.add_argument("--simple-types", action="store_true", help=simple)
    parser.add_argument("--cross-check", type=Path, metavar="DIR", help="write cross-check bundles of native FMUs, too")
    parser.add_argument("--output", type=Path, default=Path("dist"), metavar="DIR", help="default: dist")
    apart = "actuators as FMUs of their own, SCENE_STRING_actuator, beside a structure without them"
    parser.add_argument("--detach-actuators", action="store_true", help=apart)
    namings = ("structured", "flat")
    parser.add_argument("--naming", choices=namings, default="structured", help="n4.force.x or n4_force_x")
    parser.add_argument("--no-validate", dest="validate", action="store_false", help="only build")
    parser.add_argument("--thorough", action="store_true", help="validate every input at every damping")
    caching: dict[str, Any] = {"dest": "cache", "default": CACHE}
    parser.add_argument("--no-cache", action="store_const", const=None, **caching, help="run every reference anew")
    parser.add_argument("--cache", type=Path, metavar="DIR", **caching, help="folder of reference runs")
    found = parser.parse_args(words)
    if found.all:
        found.scenes = [*builtin_scenes(), *found.scenes]
    if not found.scenes:
        parser.error("name a scene, or give --all")
    if found.simple_types and found.validate:
        parser.error("--simple-types leaves outputs out that the validation reads: give --no-validate, too")
    if found.thorough and not found.validate:
        parser.error("--thorough is a kind of validation: leave it or --no-validate out")
    native = [f"--{name.replace('_', '-')}" for name in ("sources", "cross_check") if getattr(found, name)]
    if native and found.runtime == "python":
        parser.error(f"{', '.join(native)}: for native FMUs, which --runtime python leaves out")
    return found


def platforms(text: str) -> tuple[str, ...]:
    """Keys of TARGETS out of what follows --platforms.  Raises argparse.ArgumentTypeError."""
    names = tuple(name for name in map(str.strip, text.split(",")) if name)
    if names == ("all",):
        return tuple(TARGETS)
    for name in names:
        if name not in TARGETS:
            raise argparse.ArgumentTypeError(f"no platform is called {name!r}; use {', '.join(TARGETS)}, or all")
    return names


def main(words: list[str] | None = None) -> int:
    """Returns the exit code: 0; 1 where a bound was passed or a validation failed; 2 where nothing could be built."""
    options = arguments(words)
    runtimes = ("native", "python") if options.runtime == "both" else (options.runtime,)
    built: dict[tuple[str, str], Path] = {}
    try:
        here()
        models = unique([load_scene(scene) for scene in options.scenes])
        apart = take_apart(models) if options.detach_actuators else {}
        compile_first(runtimes, options.platforms)
        for model in apart.values():
            for runtime in runtimes:
                print(f"wrote {pack(model, runtime, options)}", flush=True)
        for name, model in models.items():
            for runtime in runtimes:
                built[name, runtime] = pack(model, runtime, options)
                print(f"wrote {built[name, runtime]}", flush=True)
            if options.cross_check:
                place = write_cross_check(model, options.cross_check, options.naming, options.cache, **contents(options))
                print(f"wrote {place}", flush=True)
    except (TensegrityError, OSError) as error:
        print(f"error: {shown(str(error))}", file=sys.stderr)
        return 2
    return validate(models, built, options) if options.validate else 0


def compile_first(runtimes: tuple[str, ...], names: tuple[str, ...]) -> None:
    """Compile the libraries for other platforms, which takes long, and say so.  Raises TensegrityError."""
    for kind in [kind for runtime in runtimes for kind in {"native": ["native"], "python": ["python", "kernel"]}[runtime]]:
        for name in names:
            cross_compiled(name, partial(print, flush=True), kind)


def pack(model: Model, runtime: str, options: argparse.Namespace) -> Path:
    path = options.output / runtime / f"{model.name}.fmu"
    if runtime == "python":
        return pack_python_fmu(model, path, options.naming, simple=options.simple_types, platforms=options.platforms)
    return pack_native_fmu(model, path, options.naming, **contents(options))


def contents(options: argparse.Namespace) -> dict:
    """What may be in native FMUs, see native_fmu.Contents."""
    return {"platforms": options.platforms, "sources": options.sources, "simple": options.simple_types}


def unique(scenes: list[Scene]) -> dict[str, Model]:
    """Models by name; a file that was named twice counts once.  Raises TensegrityError where two files would become one FMU."""
    found: dict[str, Model] = {}
    for scene in {Path(scene.file).resolve(): scene for scene in scenes}.values():
        if scene.name in found:
            raise TensegrityError(f"two scenes have the name {scene.name!r}; give one of them another `name`")
        found[scene.name] = build_model(scene)
    return found


def take_apart(models: dict[str, Model]) -> dict[str, Model]:
    """Takes the actuators out of the models, in place; returns theirs by name.  Raises TensegrityError where there are none."""
    found: dict[str, Model] = {}
    for name, model in models.items():
        if not model.actuated:
            remedy = "give one of its strings one, or leave the option out"
            raise TensegrityError(f"--detach-actuators: {name} has no actuator; {remedy}")
        models[name], actuators = detached(model)
        found |= {actuator.name: actuator for actuator in actuators.values()}
    return found


def validate(models: dict[str, Model], built: dict[tuple[str, str], Path], options: argparse.Namespace) -> int:
    """Validate all FMUs, the reference runs of all of them side by side; prints the table, writes the reports."""
    told = Notes(trouble(options.cache))
    runs = {name: runs_of(model, options.thorough) for name, model in models.items()}
    outside, status = {}, 0
    for (name, runtime), path in built.items():
        say(f"  {name}, {runtime}: running from outside under {len(runs[name])} inputs")
        try:
            outside[name, runtime] = run_outside(path, models[name], options.naming, repeated(runs[name]))
        except TensegrityError as error:
            status = fail(f"{name}, {runtime}", error)
    with workers() as executor:
        started = {name: submit(executor, runs[name], options.cache) for name in dict.fromkeys(name for name, _ in outside)}
        table = [HEAD]
        for (name, runtime), results in outside.items():
            try:
                validation = finish(models[name], runtime, runs[name], results, started[name], executor, options.cache, say)
            except TensegrityError as error:
                status = fail(f"{name}, {runtime}", error)
                continue
            report = built[name, runtime].with_suffix(".html")
            write_report(validation, report)
            table.append(row(validation))
            for future in started[name]:
                told.add(*future.result().notes)
            for failure in validation.failures:
                status = fail(f"{name}, {runtime}", f"{failure}; see {report}")
        say("\n".join(table))
    return status


def runs_of(model: Model, thorough: bool) -> list[Scenario]:
    """What an FMU is validated under."""
    return trials(model) + (scenarios(model, thorough=True) if thorough else [])


class Notes:
    """Says each thing once, on stderr."""

    def __init__(self, *first: str | None):
        self._said: set[str] = set()
        self.add(*(text for text in first if text))

    def add(self, *texts: str) -> None:
        for text in texts:
            if text not in self._said:
                self._said.add(text)
                print(f"note: {text}", file=sys.stderr, flush=True)


def say(text: str) -> None:
    """A line for whoever waits, at once, wherever stdout goes."""
    print(text, flush=True)


def fail(name: str, reason: object) -> int:
    print(f"FAILED {name}: {reason}", file=sys.stderr, flush=True)
    return 1


HEAD = f"{'scene':<16}{'runtime':<9}{'position error':>15}{'force error':>13}{'step':>11}{'real time':>11}"


def row(validation: Validation) -> str:
    """A line of the table: largest errors, wall time of a communication step, simulated time over wall time, and a remark."""
    return (
        f"{validation.model.name:<16}{validation.runtime:<9}{validation.position:>13.1e} m{validation.force:>11.1e} N"
        f"{1e6 * validation.seconds:>8.0f} us{validation.factor:>10.0f}x{remark(validation)}"
    )


def remark(validation: Validation) -> str:
    """Which scenarios were compared for a part of their time only, and until when."""
    cut = [f"{run.scenario.short} compared until {run.until:g} s" for run in validation.cut]
    return f"  {'; '.join(cut)}, as far as {'its' if len(cut) == 1 else 'their'} sensitivity allows" if cut else ""


if __name__ == "__main__":
    program(main)
