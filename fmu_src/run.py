"""The subcommand `tensegrity run`: an FMU over inputs from a file, as fmpy runs it."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from tensegrity_core.commands.options import Debug, Duration, InputFile, Json, SampleStep, SeriesFile
from tensegrity_core.commands.program import tell
from tensegrity_core.errors import InputError
from tensegrity_core.progress import Told

#: Types of real variables.
REALS = ("Real", "Float64")

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr


def run(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An FMU of FMI 2.0 or 3.0 for co-simulation.")],
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

    from .validation import outside, outside3

    if not os.path.exists(fmu):
        raise InputError(f"{fmu} is not there; name an FMU that is, or build one: tensegrity build SCENE")
    try:
        description = fmpy.read_model_description(str(fmu))
    except Exception as failure:  # whatever a file that is none makes fmpy say
        raise InputError(f"{fmu} is no FMU that can be read: {failure}; name another file") from failure
    if description.coSimulation is None and description.modelExchange is not None:
        remedy = "build it with --kind cs or both, or use fmpy, which integrates it by CVODE"
        raise InputError(f"{fmu} is for model exchange only, and has no solver; {remedy}")
    if description.coSimulation is None or description.fmiVersion not in ("2.0", "3.0"):
        raise InputError(f"{fmu} is no FMU of FMI 2.0 or 3.0 for co-simulation; name another file")
    elements = _elements(description)
    names, values = _held(description, elements, inputs, times)
    parameters = _starts(elements, starts)
    with scratch() as folder:
        place = fmpy.extract(str(fmu), unzipdir=str(folder / "fmu"))
        instance = None
        try:
            make = outside.Instance if description.fmiVersion == "2.0" else outside3.instances("coSimulation")
            instance = make(description, place, "run", logging=True, categories=outside.CATEGORIES[1:])
            rows, outputs, _ = outside.run(instance, times, values, names, parameters, told)
            instance.close()
        except Exception as failure:
            said = [text for status, _, text in (instance.messages if instance else ()) if status]
            raise InputError(f"{fmu} refuses the run: {said[-1] if said else str(failure).rstrip('.')}") from failure
    found = {name: ("time", column, _told(elements[name].variable)) for name, column in zip(outputs, rows.T)}
    known = {"model": description.modelName, "fmu": fmu.name, "generation_tool": description.generationTool or ""}
    return xr.Dataset(found, {"time": ("time", np.array(times), {"units": "s"})}, known)


class Element(NamedTuple):
    """A value of the FMU: a scalar variable, or one of an array's; place: among the array's, from 0."""

    variable: Any
    place: int

    @property
    def start(self) -> str | None:
        starts = (self.variable.start or "").split()
        return starts[self.place] if self.place < len(starts) else None


def _elements(description: Any) -> dict[str, Element]:
    """All values by their names: n4.force.z in FMI 2.0, n4.force[3] in FMI 3.0."""
    found = {}
    for variable in description.modelVariables:
        for place in range(math.prod(variable.shape or ())):
            name = f"{variable.name}[{place + 1}]" if variable.shape else variable.name
            found[name] = Element(variable, place)
    return found


def _other_names(elements: dict[str, Element]) -> dict[str, str]:
    """What FMI 2.0 calls elements of vectors of this package's FMUs, whose descriptions end with their axes: n4.force.z of
    n4.force[3], n4.z of n4.position[3], n1.position.z of n1.motion.position[3]."""
    from tensegrity_core.model.components import AXES

    found = {}
    for name, (variable, place) in elements.items():
        axes = (variable.description or "").rpartition("; ")[2].split(", ")
        if variable.shape and set(axes) <= set(AXES) and len(axes) == variable.shape[0]:
            common = re.sub(r"[._]position$", "", variable.name) if variable.causality == "output" else variable.name
            found[f"{re.sub(r'[._]motion[._]', '.', common)}.{axes[place]}"] = name
    return found


def _own(given: Iterable[str], elements: dict[str, Element]) -> dict[str, str]:
    """Each name as one of the FMU's, where it is one in any form."""
    from tensegrity_core.model.components import own_names

    others = _other_names(elements)
    return {name: others.get(own, own) for name, own in own_names(given, [*elements, *others]).items()}


def _told(variable: Any) -> dict[str, str]:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
    return {"long_name": variable.description or ""} | ({"units": unit} if unit else {})


def _held(description: Any, elements: dict[str, Element], path: str | None, times: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names of inputs, and the values (K, n) of their elements at the start of each step; one that has a rate moves in straight
    lines.

    Columns of other variables do not matter, so that a result's file will do.  Raises InputError.
    """
    import numpy as np

    from tensegrity_core.commands.words import one_of
    from tensegrity_core.model.inputs import just_after
    from tensegrity_core.model.signals import sampler
    from tensegrity_core.output import series

    known = {name: one for name, one in elements.items() if one.variable.causality == "input" and one.variable.type in REALS}
    rates = _rates(known)
    given = series.read(path) if path else {}
    signals: dict[str, Any] = {}
    own = _own(map(str, given), elements)
    for column, name in own.items():
        if name in signals:
            raise InputError(f"{path}: column {column} stands twice, under a structured and a flat name; leave one out")
        if name in known:
            signals[name] = sampler(column, (given["time"].values, given[column].values))
    if path and not signals:
        raise InputError(f"{path}: no column is an input of {description.modelName}; inputs are {', '.join(list(known)[:30])}")
    for column, name in own.items():
        if name not in elements:
            one_of(f"{path}: column", column, known)
    columns: dict[str, np.ndarray] = {}
    for name, sample in signals.items():
        if name in rates and rates[name] not in signals:
            whole = np.array([sample(t) for t in times])
            columns[name], columns[rates[name]] = whole[:-1], np.diff(whole) / np.diff(times)
        else:
            columns[name] = np.array([sample(t) for t in just_after(times)])
    touched = dict.fromkeys(known[name].variable.name for name in columns)
    rows = [
        columns.get(name, np.full(len(times) - 1, float(one.start or 0.0)))
        for variable in touched
        for name, one in known.items()
        if one.variable.name == variable
    ]
    return list(touched), np.array(rows).reshape(len(rows), len(times) - 1).T


def _rates(known: dict[str, Element]) -> dict[str, str]:
    """Input -> the input that is its rate."""
    places = {(one.variable.name, one.place): name for name, one in known.items()}
    wholes = {name: one.variable.derivative for name, one in known.items() if one.variable.derivative is not None}
    pairs = ((places.get((whole.name, known[name].place)), name) for name, whole in wholes.items())
    return {whole: name for whole, name in pairs if whole is not None}


def _starts(elements: dict[str, Element], texts: list[str]) -> dict[str, Any]:
    """Values by the names of variables, of arrays with those of all elements.  Raises InputError."""
    from tensegrity_core.commands.words import one_of

    known = {name: one for name, one in elements.items() if one.variable.causality in ("parameter", "input")}
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: this is not of the form NAME=X; write as in gravity=3.7")
        name = one_of("--set", _own([name], known)[name], known)
        if name in found:
            raise InputError(f"--set {text}: {name} is given twice; give it once")
        found[name] = _value(f"--set {text}", known[name], value)
    touched = dict.fromkeys(known[name].variable.name for name in found)
    values: dict[str, Any] = {
        variable: [
            found.get(name, float(one.start or 0.0)) if one.variable.shape else found[name]
            for name, one in known.items()
            if one.variable.name == variable
        ]
        for variable in touched
    }
    return {name: value if name not in known else value[0] for name, value in values.items()}


def _value(option: str, element: Element, text: str) -> float:
    """A value for an element of the FMU; of an Enumeration by its number or its name.  Raises InputError."""
    variable = element.variable
    from tensegrity_core.commands.words import finite, one_of
    from tensegrity_core.fields import METHODS

    items = {item.name: int(item.value) for item in getattr(variable.declaredType, "items", None) or ()}
    if variable.name in ("solver.method", "solver_method") and not items:  # built with --simple-types
        items = {method: i for i, method in enumerate(METHODS)}
    if items and not re.fullmatch(r"[-+0-9.eE ]+", text):
        return items[one_of(option.partition("=")[0], text, items)]
    value = finite(option, text, f"{option.partition(' ')[2].partition('=')[0]}={element.start or 1}")
    if variable.type not in REALS and value != round(value):
        raise InputError(f"{option}: {variable.name} takes whole numbers only; give one")
    return value if variable.type in REALS else round(value)
