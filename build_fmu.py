"""Builds FMUs of tensegrity scenes and validates them against the reference: python build_fmu.py three_bar_nsh"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fmu_src.pack import fmi_platform, pack_python_fmu
from fmu_src.report import write_report
from fmu_src.scenarios import scenarios
from fmu_src.validate import CACHE, Validation, finish, run_outside, submit, workers
from tensegrity_core.errors import TensegrityError
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model


def arguments(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="build_fmu.py", description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="a scene's name, or the path of a .toml file")
    parser.add_argument("--all", action="store_true", help=f"all scenes: {', '.join(builtin_scenes())}")
    parser.add_argument("--runtime", choices=("python", "native", "both"), default="python", help="default: python")
    parser.add_argument("--output", type=Path, default=Path("dist"), metavar="DIR", help="default: dist")
    namings = ("structured", "flat")
    parser.add_argument("--naming", choices=namings, default="structured", help="n4.force.x or n4_force_x")
    parser.add_argument("--no-validate", dest="validate", action="store_false", help="only build")
    parser.add_argument("--thorough", action="store_true", help="validate every input at every damping")
    parser.add_argument("--no-cache", dest="cache", action="store_const", const=None, help="run every reference anew")
    parser.add_argument("--cache", type=Path, default=CACHE, metavar="DIR", help="folder of reference runs")
    found = parser.parse_args(words)
    if found.all:
        found.scenes = [*builtin_scenes(), *found.scenes]
    if not found.scenes:
        parser.error("name a scene, or give --all")
    if found.runtime != "python":
        parser.error(f"--runtime {found.runtime}: there is no native runtime yet; use --runtime python")
    return found


def main(words: list[str] | None = None) -> int:
    """Returns the exit code: 0; 1 where a bound was passed or a validation failed; 2 where nothing could be built."""
    options = arguments(words)
    built: dict[str, Path] = {}
    try:
        fmi_platform()
        models = unique([build_model(load_scene(scene)) for scene in options.scenes])
        for name, model in models.items():
            built[name] = pack_python_fmu(model, options.output / "python" / f"{name}.fmu", options.naming)
            print(f"wrote {built[name]}", flush=True)
    except (TensegrityError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return validate(models, built, options) if options.validate else 0


def unique(models: list) -> dict:
    """Models by name.  Raises TensegrityError where two would become the same file."""
    found = {}
    for model in models:
        if model.name in found:
            raise TensegrityError(f"two scenes have the name {model.name!r}; give one of them another `name`")
        found[model.name] = model
    return found


def validate(models: dict, built: dict, options: argparse.Namespace) -> int:
    """Validate all FMUs, the reference runs of all of them side by side; prints the table, writes the reports."""
    runs = {name: scenarios(model, thorough=options.thorough) for name, model in models.items()}
    outside, started, status = {}, {}, 0
    for name, model in models.items():
        try:
            outside[name] = run_outside(built[name], model, options.naming, runs[name])
        except TensegrityError as error:
            status = fail(name, error)
    with workers() as executor:
        for name in outside:
            started[name] = submit(executor, runs[name], options.cache)
        print(HEAD, flush=True)
        for name in outside:
            try:
                validation = finish(models[name], "python", runs[name], outside[name], started[name])
            except TensegrityError as error:
                status = fail(name, error)
                continue
            report = built[name].with_suffix(".html")
            write_report(validation, report)
            print(row(validation), flush=True)
            for failure in validation.failures:
                status = fail(name, failure)
    return status


def fail(name: str, reason: object) -> int:
    print(f"FAILED {name}: {reason}", file=sys.stderr, flush=True)
    return 1


HEAD = f"{'scene':<16}{'runtime':<9}{'position error':>15}{'force error':>13}{'step':>11}{'real time':>11}"


def row(validation: Validation) -> str:
    """A line of the table: largest errors, wall time of a communication step, simulated time over wall time."""
    whole = validation.until >= min(run.scenario.inputs.times[-1] for run in validation.runs)
    cut = "" if whole else f"  compared until {validation.until:g} s, as far as the scene's sensitivity allows"
    return (
        f"{validation.model.name:<16}{validation.runtime:<9}{validation.position:>13.1e} m{validation.force:>11.1e} N"
        f"{1e6 * validation.seconds:>8.0f} us{validation.factor:>10.0f}x{cut}"
    )


if __name__ == "__main__":
    sys.exit(main())
