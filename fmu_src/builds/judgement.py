"""The validation of a build's FMUs, the table and the reports that it writes."""

from __future__ import annotations

import json
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

from tensegrity_core.errors import TensegrityError
from tensegrity_core.files import write_bytes
from tensegrity_core.model import Model
from tensegrity_core.processes import Workers
from tensegrity_core.progress import each

from ..validation.reference_cache import trouble
from ..validation.report import write_report
from ..validation.scenarios import Scenario, scenarios
from ..validation.trials import trials
from ..validation.validate import Validation, finish, repeated, run_outside, submit, workers
from .options import Options
from .work import Notes, Work

#: Between two looks at how far the references have come, s.
PAUSE = 0.1


def validate(models: dict[str, Model], built: dict[tuple[str, str], Path], pages: dict[str, bytes], work: Work) -> int:
    """Validate all FMUs, the reference runs of all of them side by side; prints the table, writes the reports.

    pages: see live_pages; each is written beside the reports of its scene.
    """
    options, told = work.options, Notes(work)
    told.add(*filter(None, [trouble(options.cache)]))
    work.bar.what = "choosing inputs"
    runs = {name: runs_of(model, options.thorough) for name, model in models.items()}
    outside, status = {}, 0
    hosts = hosted(built, options)
    wide = max(WIDE, 2 + max(len(runtime) for _, runtime, _, _ in hosts))
    for (name, runtime, kind, path), _ in each(hosts, work.running):
        work.bar.what = f"running {name}, {runtime}"
        some = repeated(runs[name]) if kind == "cs" else runs[name]
        try:
            outside[name, runtime] = run_outside(path, models[name], options.naming, some, kind=kind, fmi=options.fmi)
        except TensegrityError as error:
            status = work.fail(f"{name}, {runtime}", error)
    with workers() as executor:
        references = References(executor, work, {name: runs[name] for name in dict.fromkeys(name for name, _ in outside)})
        table, found = [head(wide)], []
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
            (fmu, report) = next(files_of(one) for one in hosts if one[:2] == (name, runtime))
            live = beside.get(name)
            write_report(validation, report, live)
            files[report] = f"report of {name}, {runtime}"
            table.append(row(validation, wide))
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


#: What is run from outside: scene, what table and report call it, kind of the host, file.
Hosted = tuple[str, str, str, Path]


def hosted(built: dict[tuple[str, str], Path], options: Options) -> tuple[Hosted, ...]:
    """An FMU of both kinds is run twice: it integrates itself, or CVODE does."""
    if options.kind != "both":
        return tuple(
            (name, options.label(runtime if options.kind == "cs" else options.kind), options.kind, path)
            for (name, runtime), path in built.items()
        )
    both = [(name, kind, path) for (name, _), path in built.items() for kind in ("cs", "me")]
    return tuple((name, options.label(f"both: {kind}"), kind, path) for name, kind, path in both)


def files_of(one: Hosted) -> tuple[Path, Path]:
    """The FMU, and its report."""
    _, runtime, kind, fmu = one
    return fmu, fmu.with_name(f"{fmu.stem}_me.html") if runtime.startswith("both") and kind == "me" else fmu.with_suffix(
        ".html"
    )


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


#: Least width of the table's column for runtimes.
WIDE = 9


def head(wide: int = WIDE) -> str:
    return f"{'scene':<16}{'runtime':<{wide}}{'position error':>15}{'force error':>13}{'step':>11}{'real time':>11}"


def row(validation: Validation, wide: int = WIDE) -> str:
    """A line of the table: largest errors, wall time of a communication step, simulated time over wall time, and a remark."""
    return (
        f"{validation.model.name:<16}{validation.runtime:<{wide}}{validation.position:>13.1e} m{validation.force:>11.1e} N"
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
