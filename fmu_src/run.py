"""The subcommand `tensegrity run`: an FMU over inputs from a file, as fmpy runs it."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_core.commands.options import Debug, Duration, InputFile, Json, SampleStep, SeriesFile
from tensegrity_core.commands.program import tell
from tensegrity_core.errors import InputError
from tensegrity_core.progress import Told

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr


def run(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An FMU of FMI 2.0 for co-simulation.")],
    inputs: InputFile = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=X", help="Start values, such as gravity=3.7 solver.method=rk4.")
    ] = None,
    duration: Duration = 5.0,
    step: SampleStep = 0.01,
    output: SeriesFile = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Run an FMU over inputs from a file, and write the series of all its outputs."""
    from tensegrity_core.commands.words import sample_times
    from tensegrity_core.output import series
    from tensegrity_core.output.export import require_writable
    from tensegrity_core.progress import Bar

    path = require_writable(output, tuple(series.WRITERS)) if output else None
    with Bar(f"running {fmu.name}") as bar:
        data = simulate(fmu, inputs, sample_times(duration, step), set_ or [], bar)
        if path:
            series.write(data, path)
    last = {str(name): values.values[-1].item() for name, values in data.items()}
    found = {"fmu": str(fmu), "time": float(data["time"][-1]), "outputs": last}
    rows = [f"    {name}: {value:z.6g} {data[name].attrs.get('units', '')}".rstrip() for name, value in last.items()]
    text = "\n".join(
        [f"{data.attrs['model']}: {found['time']:g} s in {len(data['time']) - 1} steps; outputs at the end:", *rows]
    )
    tell(found if json else text, path)


def simulate(fmu: Path, inputs: str | None, times: np.ndarray, starts: list[str], told: Told | None = None) -> xr.Dataset:
    """All outputs at the communication points, s.  told: of the steps.  Raises InputError."""
    import fmpy
    import numpy as np
    import xarray as xr

    from tensegrity_core.files import scratch

    from .validation import outside

    if not os.path.exists(fmu):
        raise InputError(f"{fmu} is not there; name an FMU that is, or build one: tensegrity build SCENE")
    try:
        description = fmpy.read_model_description(str(fmu))
    except Exception as failure:  # whatever a file that is none makes fmpy say
        raise InputError(f"{fmu} is no FMU that can be read: {failure}; name another file") from failure
    if description.coSimulation is None or description.fmiVersion != "2.0":
        raise InputError(f"{fmu} is no FMU of FMI 2.0 for co-simulation; name another file")
    names, values = _held(description, inputs, times)
    parameters = _starts(description, starts)
    with scratch() as folder:
        place = fmpy.extract(str(fmu), unzipdir=str(folder / "fmu"))
        instance = None
        try:
            instance = outside.Instance(description, place, "run", logging=True, categories=outside.CATEGORIES[1:])
            rows, outputs, _ = outside.run(instance, times, values, names, parameters, told)
            instance.close()
        except Exception as failure:
            said = [text for status, _, text in (instance.messages if instance else ()) if status]
            raise InputError(f"{fmu} refuses the run: {said[-1] if said else str(failure).rstrip('.')}") from failure
    found = {name: ("time", column, _told(instance.by_name[name])) for name, column in zip(outputs, rows.T)}
    known = {"model": description.modelName, "fmu": fmu.name, "generation_tool": description.generationTool or ""}
    return xr.Dataset(found, {"time": ("time", np.array(times), {"units": "s"})}, known)


def _told(variable: Any) -> dict[str, str]:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
    return {"long_name": variable.description or ""} | ({"units": unit} if unit else {})


def _held(description: Any, path: str | None, times: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names of inputs, and their values (K, n) at the start of each step; one that has a rate moves in straight lines.

    Columns of other variables do not matter, so that a result's file will do.  Raises InputError.
    """
    import numpy as np

    from tensegrity_core.commands.words import one_of
    from tensegrity_core.model.components import own_names
    from tensegrity_core.model.inputs import just_after
    from tensegrity_core.model.signals import sampler
    from tensegrity_core.output import series

    variables = {v.name: v for v in description.modelVariables}
    known = {name: v for name, v in variables.items() if v.causality == "input" and v.type == "Real"}
    rates = {v.derivative.name: name for name, v in known.items() if v.derivative is not None}
    given = series.read(path) if path else {}
    signals: dict[str, Any] = {}
    own = own_names(map(str, given), variables)
    for column, name in own.items():
        if name in signals:
            raise InputError(f"{path}: column {column} stands twice, under a structured and a flat name; leave one out")
        if name in known:
            signals[name] = sampler(column, (given["time"].values, given[column].values))
    if path and not signals:
        raise InputError(f"{path}: no column is an input of {description.modelName}; inputs are {', '.join(list(known)[:30])}")
    for column, name in own.items():
        if name not in variables:
            one_of(f"{path}: column", column, known)
    columns: dict[str, np.ndarray] = {}
    for name, sample in signals.items():
        if name in rates and rates[name] not in signals:
            whole = np.array([sample(t) for t in times])
            columns[name], columns[rates[name]] = whole[:-1], np.diff(whole) / np.diff(times)
        else:
            columns[name] = np.array([sample(t) for t in just_after(times)])
    return list(columns), np.array(list(columns.values())).reshape(len(columns), len(times) - 1).T


def _starts(description: Any, texts: list[str]) -> dict[str, float]:
    """Raises InputError."""
    from tensegrity_core.commands.words import one_of
    from tensegrity_core.model.components import own_names

    known = {v.name: v for v in description.modelVariables if v.causality in ("parameter", "input")}
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: this is not of the form NAME=X; write as in gravity=3.7")
        name = one_of("--set", own_names([name], known)[name], known)
        if name in found:
            raise InputError(f"--set {text}: {name} is given twice; give it once")
        found[name] = _value(f"--set {text}", known[name], value)
    return found


def _value(option: str, variable: Any, text: str) -> float:
    """A value for a variable of the FMU; of an Enumeration by its number or its name.  Raises InputError."""
    from tensegrity_core.commands.words import finite, one_of
    from tensegrity_core.fields import METHODS

    items = {item.name: int(item.value) for item in getattr(variable.declaredType, "items", None) or ()}
    if variable.name in ("solver.method", "solver_method") and not items:  # built with --simple-types
        items = {method: i for i, method in enumerate(METHODS)}
    if items and not re.fullmatch(r"[-+0-9.eE ]+", text):
        return items[one_of(option.partition("=")[0], text, items)]
    value = finite(option, text, f"{variable.name}={variable.start or 1}")
    if variable.type != "Real" and value != round(value):
        raise InputError(f"{option}: {variable.name} takes whole numbers only; give one")
    return value if variable.type == "Real" else round(value)
