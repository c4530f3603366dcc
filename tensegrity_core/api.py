"""What a script uses: load a scene, vary it, simulate it, find where it rests and how it moves there, and build its FMUs.

`import tensegrity_core as tc` has all of it: `tc.load`, `tc.simulate` ...  Quantities are in SI units, and have the names that
they have in an FMU: n4.z, s1.force, energy.kinetic.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from . import kernel, statics
from .equilibria import linearization, steady_states
from .equilibria.modes import Mode
from .equilibria.modes import modes as small_motions
from .errors import InputError
from .fields import outputs
from .interchange import export_scene as export_scene
from .interchange import import_scene as import_scene
from .model import Inputs, Model, Result, grid
from .model.components import names, own_names
from .model.inputs import INPUTS, carried, require_room
from .model.signals import Signal, driven, places, require_known, sampler
from .output import series
from .output.export import require_writable
from .output.state_space import StateSpace, require_tensions, row_at
from .quantities import number
from .scene import builtin_scenes, load_scene, parse_scene

Scene = str | Path | Model


class _Named:
    """What has quantities by their names."""

    data: xr.Dataset

    def __getitem__(self, name: str) -> xr.DataArray:
        """A quantity by its name.  Raises InputError for a name that is none, with those that are close."""
        if not isinstance(name, str) or name not in self.data:
            close = difflib.get_close_matches(str(name), [str(known) for known in self.data], n=3)
            guess = f"did you mean {', '.join(close)}?" if close else f"names are {', '.join(map(str, self.data))}"
            raise InputError(f"there is no {name!r}; {guess}")
        return self.data[name]


@dataclass(frozen=True, eq=False)
class Run(_Named):
    """A simulation's result.

    data: xarray Dataset, see output/series.py; model: the scene as it was simulated; result: the same series as arrays;
    inputs: what it was given.  `run["n4.z"]` is a series with its unit.
    """

    model: Model
    data: xr.Dataset
    result: Result
    inputs: Inputs

    @property
    def transitions(self) -> pd.DataFrame:
        """A row a transition: time (s), string, before, after, loss (J)."""
        return series.transitions(self.data)

    def to_frame(self) -> pd.DataFrame:
        """A column a series, over time (s)."""
        found = {str(name): values.values for name, values in self.data.items() if values.dims == ("time",)}
        return pd.DataFrame(found, index=pd.Index(self.data["time"].values, name="time"))

    def save(self, path: str | Path) -> Path:
        """Write it as .nc, .parquet or .csv.  Raises InputError where that cannot be written."""
        return series.write(self.data, path)


@dataclass(frozen=True, eq=False)
class Equilibrium(_Named):
    """A steady state.  model: the scene, starting there; data: Dataset of the state, `state["n4.z"]` a number with its unit."""

    model: Model
    data: xr.Dataset


def scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return builtin_scenes()


def load(scene: Scene, changes: Mapping[str, Any] | None = None) -> Model:
    """The model of a scene: a built-in one by its name, or a scene file by its path.

    changes: what to vary, by its place in the scene file: {"gravity": 0.0, "materials.cable.stiffness": 900.0}.  A table joins
    the one that stands there, anything else takes its place.  A model is passed on as it is.  Raises SceneError for a scene
    that cannot become a model.
    """
    if isinstance(scene, Model):
        if changes:
            raise InputError("changes are made to a scene, not to its model; load the scene with them")
        return scene
    found = load_scene(scene)
    if changes is not None and not (isinstance(changes, Mapping) and all(isinstance(key, str) for key in changes)):
        raise InputError(f"changes = {changes!r} is no dictionary by places in the scene file, such as {{'gravity': 0.0}}")
    if changes:
        found = parse_scene({"extends": str(Path(found.file).resolve()), "name": found.name} | _tables(changes), "changes")
    return statics.build_model(found)


def _tables(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Changes by their places as the tables of a scene file.  Raises InputError."""
    if "extends" in changes:
        raise InputError("changes: another scene is not a change; load that scene")
    data: dict[str, Any] = {}
    for key, value in changes.items():
        table = data
        *tables, last = key.split(".")
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError(f"changes: {key} lies in {name}, which is changed as a whole; give one of them")
        if last in table:
            raise InputError(f"changes: {key} and what lies in it are given apart; give one of them")
        empty = _empty(key, value)
        if empty:
            raise InputError(f"changes: {empty} = {{}} changes nothing; name a value in it, as in bars.b1.mass")
        table[last] = deepcopy(value)
    return data


def _empty(key: str, value: Any) -> str:
    """The place of an empty table in a value, or ''."""
    if not isinstance(value, Mapping):
        return ""
    return next(filter(None, (_empty(f"{key}.{name}", inner) for name, inner in value.items())), "") if value else key


def simulate(
    scene: Scene,
    inputs: Mapping[str, Signal] | pd.DataFrame | xr.Dataset | str | Path | None = None,
    duration: float = 5.0,
    step: float = 0.01,
    method: str = "auto",
    tolerance: float = 1e-10,
    max_step: float = 0.0,
) -> Run:
    """Simulate a scene with the C kernel.

    inputs: by name, a number, a function of t, or times and values, such as {"n4.force.z": 45.0},
    {"s1.rest_length": lambda t: 0.8 - 0.01 * t}, {"n4.force.z": ([0.0, 1.0, 1.0], [0.0, 0.0, 45.0])}; or a file with a column
    `time`, see `read_inputs`.  What is not given stays as the scene starts.  duration: s; step: s between samples; method,
    tolerance: see docs/methods.md; max_step: the largest step, s, of rk4 and ros2 the step.  Raises TensegrityError.
    """
    model, times = load(scene), grid(duration, step)
    require_room(model, len(times))
    given = driven(model, times, _signals(inputs, model))
    result = kernel.simulate(model, given, method, tolerance, max_step)
    return Run(model, series.dataset(model, result, method=method, tolerance=tolerance, max_step=max_step), result, given)


def _signals(inputs: Any, model: Model) -> Mapping[str, Signal]:
    """What `simulate` takes, as signals by name.  Raises InputError."""
    if inputs is None:
        return {}
    if isinstance(inputs, str | Path):
        return read_inputs(inputs, model)
    if isinstance(inputs, pd.DataFrame):
        try:
            inputs = series.from_frame(inputs)
        except series.BadSeries as failure:
            raise InputError(f"inputs: {failure}") from None
    if isinstance(inputs, xr.Dataset):
        return _columns(inputs, model, "inputs")
    if not isinstance(inputs, Mapping):
        raise InputError(f"inputs = {inputs!r}: give a dictionary by name, a table with a column `time`, or the name of a file")
    return inputs


def read_inputs(path: str | Path, model: Model) -> dict[str, Signal]:
    """Signals out of a .csv, .nc or .parquet file: a column `time` (s), and columns with names of inputs.

    Straight lines join the rows; two rows of one time are a jump.  Columns of outputs do not matter, so that a result's file
    will do.  Raises InputError for a column that is neither, and where none is an input.
    """
    return _columns(series.read(path), model, str(path))


def _columns(data: xr.Dataset, model: Model, where: str) -> dict[str, Signal]:
    """Signals out of a Dataset over time.  Raises InputError."""
    known, ignored = places(model), {name for field in outputs() for name in names(field, model)}
    own = own_names(map(str, data), [*known, *ignored])
    signals: dict[str, Signal] = {}
    for column, name in own.items():
        values = data[column]
        if name in ignored or name.startswith("transition."):
            continue
        if name in signals:
            raise InputError(f"{where}: {column} stands twice, under a structured and a flat name; leave one out")
        if values.dims != ("time",):
            raise InputError(f"{where}: {name} is over {', '.join(map(str, values.dims))}; give it over time alone")
        signals[name] = (data["time"].values, values.values)
        if name in known:
            _require_signal(where, name, signals[name])
    require_known(model, signals, where)
    if not signals:
        raise InputError(f"{where}: no column is an input of {model.name}; inputs are {', '.join(list(known)[:30])}")
    return signals


def _require_signal(where: str, name: str, signal: Signal) -> None:
    """Raises InputError with the name of the file, too, for times and values that make no signal."""
    try:
        sampler(name, signal)
    except InputError as failure:
        raise InputError(f"{where}: {failure}") from None


def equilibrium(scene: Scene, forces: Mapping[str, float] | None = None) -> Equilibrium:
    """The steady state that forces reach which grow slowly, from where the scene starts: {"n4.force.z": 45.0}, N.

    Raises TensegrityError where there is none.
    """
    model = load(scene)
    force = _constant(model, forces)
    model = steady_states.reached(model, force) if force.any() else statics.settle(model)
    result = kernel.simulate(model, driven(model, grid(1e-3, 1e-3), forces or {}))  # only its first row counts
    data = series.dataset(model, result, loaded=_words(forces)).isel(time=0).drop_dims("transition")
    return Equilibrium(model, data)


def modes(scene: Scene | Equilibrium, forces: Mapping[str, float] | None = None, damped: bool = True) -> list[Mode]:
    """Small motions about the steady state under forces, the longest-lived first; see equilibria/modes.py.

    Raises TensegrityError.
    """
    state = scene if isinstance(scene, Equilibrium) else equilibrium(scene, forces)
    return small_motions(state.model, _constant(state.model, forces), damped=damped)


def linearize(
    scene: Scene | Equilibrium | Run,
    forces: Mapping[str, float] | None = None,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    motions: bool = False,
    side: str | None = None,
    time: float | None = None,
) -> StateSpace:
    """The linear system A, B, C, D about the steady state under forces, or about a row of a run; see docs/linearization.md.

    inputs, outputs: by name, None: all; motions: inputs whose rates are inputs too become states that the rates move; side:
    of a string at an end of its piece, 'longer' or 'shorter'; time: of the run's row, s, None: of the last.  Raises
    TensegrityError.
    """
    row = 0
    if not isinstance(motions, bool):
        raise InputError(f"motions = {motions!r}: give True or False; single inputs are chosen by inputs")
    if isinstance(scene, Run):
        if forces:
            raise InputError("forces: a run has its own; leave them out")
        row = row_at(scene.result.times, time, scene.model.name)
        model, at = scene.model, _state_of(scene, row)
    elif time is not None:
        raise InputError(f"time = {time!r}: a steady state has none; give a run, or leave it out")
    else:
        rest = scene if isinstance(scene, Equilibrium) else equilibrium(scene, forces)
        model, at = rest.model, linearization.at_rest(rest.model, _constant(rest.model, forces))
    found = StateSpace.of(model.name, linearization.linearize(model, at, side))
    if isinstance(scene, Run):
        require_tensions(found, scene.model, scene.result.elastic_force[row], scene.model.memories)
    found = found.only(inputs, outputs)
    return found.with_motions() if motions else found


def _state_of(run: Run, row: int) -> linearization.State:
    """The state in a row of a run, and the inputs that were held up to it; in the first row, those that follow."""
    model, result, step = run.model, run.result, max(row - 1, 0)
    given = run.inputs.resolved(model)
    start = {name: np.asarray(getattr(given, name), dtype=float)[step] for name in INPUTS}
    last = carried(start, float(result.times[row] - result.times[step]))
    velocity, moving = result.velocity[row].copy(), list(model.moving)
    velocity[moving] = np.where(model.moved[moving], last["node_velocity"], velocity[moving])
    last["rest_length"][list(model.actuated)] = result.wound_rest_length[row]
    return linearization.State(result.position[row], velocity, result.motor_speed[row], last)


def _constant(model: Model, forces: Mapping[str, float] | None) -> np.ndarray:
    """(N, 3) N.  Raises InputError for what is no force on a free node, or no number."""
    given = {name: number(str(name), value) for name, value in _signals(forces, model).items()}
    require_known(model, given)
    for name, value in given.items():
        if places(model)[name][0] != "force":
            raise InputError(f"{name}: a steady state is asked for under forces; load the scene with other values instead")
        if not np.isfinite(value):
            raise InputError(f"{name} = {value!r} is not a finite number; give one")
    return driven(model, np.array([0.0, 1.0]), given).force[0]


def build(
    scene: str | Path,
    output: str | Path = "dist",
    runtime: str = "both",
    validate: bool = False,
    kind: str = "cs",
    fmi: str = "2.0",
) -> dict[str, Path]:
    """Build a scene's FMUs: runtime ("native", "python") -> file.  With `validate` they are compared with the reference, too.

    kind: "cs" (co-simulation), "me" (model exchange) or "both" in one FMU; fmi: "2.0" or "3.0".  Only co-simulation of FMI 2.0
    has Python FMUs, too.  Raises TensegrityError where one cannot be built, or passes a bound.
    """
    if isinstance(scene, Model):
        raise InputError(f"{scene.name}: FMUs are built of a scene; give its name or file, not its model")
    builds = importlib.import_module("fmu_src.builds")
    runtimes = builds.runtimes(runtime, native=kind != "cs" or fmi != "2.0")
    return builds.built(builds.Options((str(scene),), runtimes, fmi, kind, output=Path(output), validate=validate))


def view(what: Scene | Run | Equilibrium, output: str | Path | None = None) -> Path:
    """Write the page in which a scene moves and can be pulled, or in which a run is played back; see docs/view.md.

    output: an .html file, NAME.html where nothing is said.  Raises TensegrityError.
    """
    from .output.page import write_page

    model = what.model if isinstance(what, Run | Equilibrium) else load(what)
    path = require_writable(output or f"{model.name}.html", (".html",))
    if isinstance(what, Run):
        write_page(path, model, what.result, np.concatenate((what.inputs.force, what.inputs.force[-1:])))
    else:
        write_page(path, model)
    return path


def _words(forces: Mapping[str, float] | None) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in (forces or {}).items())
