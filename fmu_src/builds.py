"""Builds FMUs of scenes, validates them against the reference, and says how it went."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_core.errors import InputError, TensegrityError, shown
from tensegrity_core.files import write_bytes
from tensegrity_core.model import Model
from tensegrity_core.native.build import TARGETS
from tensegrity_core.output.page import found as page_parts
from tensegrity_core.output.page import page, parts
from tensegrity_core.processes import Workers
from tensegrity_core.progress import Bar, Shares, each, expected
from tensegrity_core.scene import Scene, load_scene
from tensegrity_core.statics import build_model

from .packing.actuator import detached
from .packing.libraries import cross_compiled, here
from .packing.native_fmu import pack_native_fmu
from .packing.pack import pack_python_fmu
from .packing.ssp import VERSIONS, detached_system, write_ssp
from .validation.cross_check import write_cross_check
from .validation.reference_cache import trouble
from .validation.report import write_report
from .validation.scenarios import Scenario, scenarios
from .validation.trials import trials
from .validation.validate import CACHE, Validation, finish, repeated, run_outside, submit, workers
from .variables.described import KINDS


@dataclass(frozen=True)
class Options:
    """What is built of each scene, and how it is checked.

    scenes: names or paths; runtimes: of "native", "python"; kind: one of KINDS; platforms: beside this one, keys of TARGETS;
    sources, cross_check: of native FMUs; simple: see Contents; page: the page in which the scene moves goes into their
    documentation and beside the reports; apart: actuators as FMUs of their own; ssp: version of the archive that couples
    these with the structure, None for none; cache: folder of reference runs, None for none; json: the table as JSON on
    standard output, and everything else on standard error.
    """

    scenes: tuple[str, ...]
    runtimes: tuple[str, ...] = ("native", "python")
    kind: str = "cs"
    platforms: tuple[str, ...] = ()
    sources: bool = False
    simple: bool = False
    page: bool = True
    cross_check: Path | None = None
    output: Path = Path("dist")
    apart: bool = False
    ssp: str | None = None
    naming: str = "structured"
    validate: bool = True
    thorough: bool = False
    cache: Path | None = CACHE
    json: bool = False

    def __post_init__(self):
        """Raises InputError."""
        if not self.scenes:
            raise InputError("no scene is named; name one, or give --all")
        if not (self.runtimes and set(self.runtimes) <= {"native", "python"}):
            raise InputError(f"runtime = {', '.join(map(str, self.runtimes))!r} is none; use native, python or both")
        if self.kind not in KINDS:
            raise InputError(f"--kind {self.kind}: there is no such kind; use {', '.join(KINDS)}")
        if self.kind != "cs":
            self._require_exchange()
        if self.simple and self.validate:
            raise InputError("--simple-types leaves outputs out that the validation reads: give --no-validate, too")
        if self.ssp is not None and self.ssp not in VERSIONS:
            raise InputError(f"--ssp {self.ssp}: no such version is written; use {' or '.join(VERSIONS)}")
        if self.ssp and not self.apart:
            raise InputError("--ssp couples a structure with actuators of their own: give --detach-actuators, too")
        if self.thorough and not self.validate:
            raise InputError("--thorough is a kind of validation: leave it or --no-validate out")
        native = [option for option, given in (("--sources", self.sources), ("--cross-check", self.cross_check)) if given]
        if native and "native" not in self.runtimes:
            raise InputError(f"{', '.join(native)}: for native FMUs, which --runtime python leaves out")

    def _require_exchange(self) -> None:
        """Raises InputError where model exchange does not go with what else is asked for."""
        other = {
            "--runtime python: the Python runtime has co-simulation only; give --runtime native": "python" in self.runtimes,
            "--simple-types": self.simple,
            "--detach-actuators": self.apart,
            "--cross-check": self.cross_check,
        }
        for option in (option for option, given in other.items() if given):
            raise InputError(f"--kind {self.kind} does not go with {option}")


#: About how long it takes, s: to compile a library, to build what pages have in common, to pack an FMU, to run one from
#: outside, to run the references of a scene, to write an FMU's report.
COMPILING, PAGING, PACKING, RUNNING, REFERENCES, REPORTING = 10.0, 15.0, 0.5, 1.5, 8.0, 1.0
#: Between two looks at how far the references have come, s.
PAUSE = 0.1


class Work:
    """A build under way: how far its stages have come, and what is said meanwhile, out of the bar's way."""

    def __init__(self, options: Options, bar: Bar, scenes: int):
        self.options, self.bar = options, bar
        shares, fmus, validated = Shares(bar), scenes * len(options.runtimes), float(options.validate)
        self.compiling = shares.share(len(options.platforms) * len(options.runtimes) * COMPILING)
        self.paging = shares.share(PAGING if options.page and page_parts() is None else 0.0)
        self.packing = shares.share(fmus * PACKING)
        self.running = shares.share(fmus * RUNNING * validated)
        self.integrating = shares.share(scenes * REFERENCES * validated)
        self.reporting = shares.share(fmus * REPORTING * validated)

    def say(self, text: str) -> None:
        """A line for whoever waits, at once, wherever it goes."""
        with self.bar.aside():
            print(text, file=sys.stderr if self.options.json else sys.stdout, flush=True)

    def tell(self, text: str) -> None:
        """What was asked for."""
        self.bar.end()
        print(text)

    def fail(self, name: str, reason: object) -> int:
        with self.bar.aside():
            print(f"FAILED {name}: {reason}", file=sys.stderr, flush=True)
        return 1


def platforms(text: str) -> tuple[str, ...]:
    """Keys of TARGETS out of what follows --platforms.  Raises InputError."""
    names = tuple(name for name in map(str.strip, text.split(",")) if name)
    if names == ("all",):
        return tuple(TARGETS)
    for name in names:
        if name not in TARGETS:
            raise InputError(f"--platforms: no platform is called {name!r}; use {', '.join(TARGETS)}, or all")
    return names


def make(options: Options) -> int:
    """Build and validate.  Returns the exit code: 0; 1 where a bound was passed or a validation failed; 2 where nothing
    could be built."""
    with Bar("building") as bar:
        try:
            here()
            models = unique([load_scene(scene) for scene in options.scenes])
            work = Work(options, bar, len(models))
            pages = live_pages(models, work)
            built = pack_all(models, pages, work)
        except (TensegrityError, OSError) as error:
            with bar.aside():
                print(f"error: {shown(str(error))}", file=sys.stderr)
            return 2
        return validate(models, built, pages, work) if options.validate else 0


def built(options: Options) -> dict[str, Path]:
    """The FMUs of one scene by their runtimes, for scripts.  Raises TensegrityError, also where a bound was passed."""
    (model,) = unique([load_scene(scene) for scene in options.scenes]).values()
    with Bar("building") as bar:
        work = Work(options, bar, 1)
        make_folder(options.output)
        compile_first(work)
        pages = live_pages({model.name: model}, work)
        found = {runtime: pack(model, runtime, options, pages.get(model.name)) for runtime in options.runtimes}
        named = {(model.name, runtime): path for runtime, path in found.items()}
        if options.validate and validate({model.name: model}, named, pages, work):
            raise TensegrityError(
                f"{model.name}: the validation failed; what passed its bound stands in the reports beside the FMUs"
            )
    return found


def pack_all(models: dict[str, Model], pages: dict[str, bytes], work: Work) -> dict[tuple[str, str], Path]:
    """FMUs by scene and runtime; those of actuators and cross-check bundles are written, too.  Raises TensegrityError."""
    options = work.options
    apart = take_apart(models) if options.apart else {}
    make_folder(options.output)
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
            place = write_cross_check(
                model, options.cross_check, options.naming, options.cache, told, **contents(options, pages.get(name))
            )
            work.say(f"wrote {place}")
    return found


def make_folder(folder: Path) -> None:
    """Raises InputError where it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise InputError(f"--output {folder}: no such folder can be made: {reason}; name another one") from failure


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
    path = options.output / (runtime if options.kind == "cs" else options.kind) / f"{model.name}.fmu"
    if runtime == "python":
        return pack_python_fmu(model, path, options.naming, simple=options.simple, platforms=options.platforms, page=live)
    return pack_native_fmu(model, path, options.naming, **contents(options, live))


def contents(options: Options, live: bytes | None = None) -> dict:
    """What may be in native FMUs, see native_fmu.Contents."""
    chosen = {"platforms": options.platforms, "sources": options.sources, "simple": options.simple, "page": live}
    return chosen | {"kind": options.kind}


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


def validate(models: dict[str, Model], built: dict[tuple[str, str], Path], pages: dict[str, bytes], work: Work) -> int:
    """Validate all FMUs, the reference runs of all of them side by side; prints the table, writes the reports.

    pages: see live_pages; each is written beside the reports of its scene.
    """
    options, told = work.options, Notes(work)
    told.add(*filter(None, [trouble(options.cache)]))
    work.bar.what = "choosing inputs"
    runs = {name: runs_of(model, options.thorough) for name, model in models.items()}
    outside, status = {}, 0
    for (name, runtime, kind, path), _ in each(hosted(built, options.kind), work.running):
        work.bar.what = f"running {name}, {runtime}"
        some = repeated(runs[name]) if kind == "cs" else runs[name]
        try:
            outside[name, runtime] = run_outside(path, models[name], options.naming, some, kind=kind)
        except TensegrityError as error:
            status = work.fail(f"{name}, {runtime}", error)
    with workers() as executor:
        references = References(executor, work, {name: runs[name] for name in dict.fromkeys(name for name, _ in outside)})
        table, found = [HEAD], []
        files: dict[Path, str] = {}
        beside = {name: write_live(options.output, name, pages[name]) for name in references.started if name in pages}
        for ((name, runtime), results), _ in each(tuple(outside.items()), work.reporting):
            work.bar.what = f"integrating the reference of {name}"
            try:
                validation = finish(
                    models[name],
                    runtime,
                    runs[name],
                    results,
                    references.started[name],
                    executor,
                    options.cache,
                    work.say,
                    references.wait,
                )
            except TensegrityError as error:
                status = work.fail(f"{name}, {runtime}", error)
                continue
            fmu, report = file_and_report(built, name, runtime)
            live = beside.get(name)
            write_report(validation, report, live)
            files[report] = f"report of {name}, {runtime}"
            table.append(row(validation))
            found.append(data(validation, fmu, report, live))
            for future in references.started[name]:
                told.add(*future.result().notes)
            for failure in validation.failures:
                status = work.fail(f"{name}, {runtime}", f"{failure}; see {report}")
    work.tell(
        json.dumps(found, indent=2, allow_nan=False)
        if options.json
        else "\n".join([*table, *shown_files(files | {live: f"{name}, in motion" for name, live in beside.items()})])
    )
    return status


#: How a row of the table calls an FMU of both kinds by who integrates it: the FMU, or CVODE.
BOTH = {"cs": "both: cs", "me": "both: me"}


def hosted(built: dict[tuple[str, str], Path], kind: str) -> tuple[tuple[str, str, str, Path], ...]:
    """Scene, name of the runtime or kind, kind of the host, file: what is run from outside; an FMU of both kinds twice."""
    if kind != "both":
        return tuple((name, runtime if kind == "cs" else kind, kind, path) for (name, runtime), path in built.items())
    return tuple((name, row, host, path) for (name, _), path in built.items() for host, row in BOTH.items())


def file_and_report(built: dict[tuple[str, str], Path], name: str, runtime: str) -> tuple[Path, Path]:
    """An FMU by the scene and what `hosted` calls its runtime, and the file of its report."""
    fmu = built.get((name, runtime)) or built[name, "native"]
    return fmu, fmu.with_name(f"{fmu.stem}_me.html") if runtime == BOTH["me"] else fmu.with_suffix(".html")


class References:
    """The reference runs of some scenes, side by side: started by scene, and waited for."""

    def __init__(self, executor: Workers, work: Work, runs: dict[str, list[Scenario]]):
        self.work, self.parts = work, executor.parts
        self.started: dict[str, list[Future]] = {}
        for name, some in runs.items():
            self.started[name] = submit(executor, some, work.options.cache, len(self.all))

    @property
    def all(self) -> list[Future]:
        return [future for some in self.started.values() for future in some]

    def wait(self, future: Future) -> None:
        """Until one is done, and show meanwhile how far all have come."""
        while not future.done():
            wait([future], PAUSE)
            every = self.all
            self.work.integrating(sum(1.0 if one.done() else self.parts[i] for i, one in enumerate(every)) / len(every))


def shown_files(files: dict[Path, str]) -> list[str]:
    """Lines that say where reports and pages are, by what they are, and how to look at one."""
    if not files:
        return ["no report"]
    wide = max(map(len, files.values()))
    lines = [f"  {what:<{wide}}  {path}" for path, what in files.items()]
    last = next(reversed(files)).resolve().as_uri()
    return ["to be opened in a browser:", *lines, f"such as {last}"]


def write_live(folder: Path, name: str, content: bytes) -> Path:
    """The page in which a scene moves, in a file of its own."""
    path = folder / f"{name}_live.html"
    write_bytes(path, content)
    return path


def runs_of(model: Model, thorough: bool) -> list[Scenario]:
    """What an FMU is validated under."""
    return trials(model) + (scenarios(model, thorough=True) if thorough else [])


class Notes:
    """Says each thing once, on stderr."""

    def __init__(self, work: Work):
        self._work, self._said = work, set()  # type: ignore[var-annotated]

    def add(self, *texts: str) -> None:
        for text in texts:
            if text not in self._said:
                self._said.add(text)
                with self._work.bar.aside():
                    print(f"note: {text}", file=sys.stderr, flush=True)


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


def data(validation: Validation, fmu: Path, report: Path, page: Path | None) -> dict[str, Any]:
    """The same, as JSON takes it: m, N, s."""
    return {
        "scene": validation.model.name,
        "runtime": validation.runtime,
        "fmu": str(fmu),
        "report": str(report),
        "page": str(page) if page else None,
        "position_error": validation.position,
        "force_error": validation.force,
        "seconds_per_step": validation.seconds,
        "real_time_factor": validation.factor,
        "compared_until": {run.scenario.short: run.until for run in validation.cut},
        "failures": [str(failure) for failure in validation.failures],
    }
