"""The FMUs of a build, with all that goes into them or is written beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tensegrity_core.errors import InputError, TensegrityError
from tensegrity_core.model import Model
from tensegrity_core.output.page import page, parts
from tensegrity_core.progress import each, expected
from tensegrity_core.scene import Scene
from tensegrity_core.statics import build_model

from ..packing.actuator import detached
from ..packing.libraries import cross_compiled
from ..packing.native_fmu import pack_native_fmu
from ..packing.pack import pack_python_fmu
from ..packing.ssp import detached_system, write_ssp
from ..validation.cross_check import write_cross_check
from .options import Options
from .work import COMPILING, Notes, Work


def pack_all(models: dict[str, Model], pages: dict[str, bytes], work: Work) -> dict[tuple[str, str], Path]:
    """FMUs by scene and runtime; those of actuators and cross-check bundles are written, too.  Raises TensegrityError."""
    options = work.options
    apart = take_apart(models) if options.apart else {}
    make_folder(options.output)
    if options.cross_check:
        make_folder(options.cross_check, "--cross-check")
    compile_first(work)
    motors: dict[tuple[str, str], Path] = {}
    for model in [motor for motors_of in apart.values() for motor in motors_of.values()]:
        for runtime in options.runtimes:
            motors[model.name, runtime] = pack(model, runtime, options)
            work.say(f"wrote {motors[model.name, runtime]}")
    found = {}
    for (name, model), told in each(tuple(models.items()), work.packing):
        work.bar.what = f"packing {name}"
        for runtime in options.runtimes:
            found[name, runtime] = pack(model, runtime, options, pages.get(name))
            work.say(f"wrote {found[name, runtime]}")
            if options.ssp:
                packed = {one: path for (one, of), path in (motors | found).items() if of == runtime}
                system = detached_system(model, apart[name], packed, options.naming)
                work.say(f"wrote {write_ssp(options.output / runtime / f'{name}.ssp', system, options.ssp)}")
        if options.cross_check:
            chosen = contents(options, pages.get(name))
            for place in write_cross_check(model, options.cross_check, options.naming, options.cache, told, **chosen):
                work.say(f"wrote {place}")
    return found


def make_folder(folder: Path, option: str = "--output") -> None:
    """Raises InputError where it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise InputError(f"{option} {folder}: no such folder can be made: {reason}; name another one") from failure


def compile_first(work: Work) -> None:
    """Compile the libraries for other platforms, which takes long, and say so.  Raises TensegrityError."""
    kinds = {"native": ["native"], "python": ["python", "kernel"]}
    libraries = [(kind, name) for r in work.options.runtimes for kind in kinds[r] for name in work.options.platforms]
    for (kind, name), told in each(libraries, work.compiling):
        work.bar.what = f"compiling for {name}"
        with expected(COMPILING, told):
            cross_compiled(name, work.say, kind)


def live_pages(models: dict[str, Model], work: Work) -> dict[str, bytes]:
    """The page in which a scene runs, by its name.  None where it is not wanted or cannot be made here, which is said once."""
    if not work.options.page:
        return {}
    work.bar.what = "building the page"
    try:
        common = parts(work.say, work.paging)
    except TensegrityError as lacking:
        Notes(work).add(f"FMUs and reports come without the page in which the scene moves: {lacking}")
        return {}
    return {name: page(model, common=common).encode() for name, model in models.items()}


def pack(model: Model, runtime: str, options: Options, live: bytes | None = None) -> Path:
    """Raises TensegrityError, also for a model that an FMU of this kind does not know."""
    if model.ground is not None and options.kind != "cs":
        raise InputError(f"{model.name}: it stands on the ground, which model exchange does not know yet; build with --kind cs")
    path = options.folder(runtime) / f"{model.name}.fmu"
    if runtime == "python":
        return pack_python_fmu(model, path, options.naming, simple=options.simple, platforms=options.platforms, page=live)
    return pack_native_fmu(model, path, options.naming, **contents(options, live))


def contents(options: Options, live: bytes | None = None) -> dict:
    """What may be in native FMUs, see native_fmu.Contents."""
    chosen = {"platforms": options.platforms, "sources": options.sources, "simple": options.simple, "page": live}
    return chosen | {"kind": options.kind, "standard": options.fmi, "binaries": options.binaries}


def unique(scenes: list[Scene]) -> dict[str, Model]:
    """Models by name; a file that was named twice counts once.  Raises TensegrityError where two files would become one FMU."""
    found: dict[str, Model] = {}
    for scene in {Path(scene.file).resolve(): scene for scene in scenes}.values():
        if scene.name in found:
            raise TensegrityError(f"two scenes have the name {scene.name!r}; give one of them another `name`")
        found[scene.name] = build_model(scene)
    return found


def take_apart(models: dict[str, Model]) -> dict[str, Mapping[str, Model]]:
    """Takes the actuators out of the models, in place; returns theirs by the structure's name and the string's.  Raises
    TensegrityError where there are none."""
    found: dict[str, Mapping[str, Model]] = {}
    for name, model in models.items():
        if not model.actuated:
            remedy = "give one of its strings one, or leave the option out"
            raise TensegrityError(f"--detach-actuators: {name} has no actuator; {remedy}")
        models[name], found[name] = detached(model)
    return found
