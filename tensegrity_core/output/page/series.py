"""Results out of files that `tensegrity simulate` and `run` wrote, for a page that plays them back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from ...fields import outputs, size
from ...model import Model, Result, Transition
from ...model.components import full_shape, named, spread
from .. import series

if TYPE_CHECKING:
    import xarray as xr

#: Suffixes of such files.
SUFFIXES = (*series.READERS, ".npz")
#: Of a transition, beside its time and its string.
REST = ("before", "after", "loss")
#: How far a bar's length may be from the model's, relative; a run of the model keeps it to round-off.
BAR_ERROR = 1e-6


def result_of_file(path: Path, model: Model) -> Result:
    """The result of a file of this model's run; a .csv file has no transitions.  Raises InputError."""
    try:
        result = _from_npz(path, model) if path.suffix.lower() == ".npz" else _from_table(path, model)
        _require_bars(path, model, result)
        return result
    except InputError:
        raise
    except Exception as failure:
        reason = str(failure.strerror) if isinstance(failure, OSError) and failure.errno else "it is none, or a damaged one"
        raise InputError(f"result = {str(path)!r} cannot be read: {reason}; write it anew: tensegrity simulate") from failure


def _from_table(path: Path, model: Model) -> Result:
    data = series.read(path)
    times = data["time"].values
    columns = {"time": times} | {str(name): one.values for name, one in data.items() if one.dims == ("time",)}
    wanted = {field.name: named(field, model) for field in outputs()}
    known = ["time", *(name for group in wanted.values() for name in group)]
    missing, odd = ([name for name in one if name not in other] for one, other in ((known, columns), (columns, known)))
    if missing:
        raise _of_another(path, model, f"it has no column {missing[0]!r}")
    if odd:
        raise _of_another(path, model, f"its column {odd[0]!r} is none of {model.name}'s")
    found = {}
    for field in outputs():
        flat = np.zeros((len(times), size(field, model.counts)))
        for name, place in wanted[field.name].items():
            flat[:, place] = columns[name]
        found[field.name] = spread(field, model, flat.astype(int) if field.compared == "count" else flat)
    return Result(times, _transitions(data, model), {}, **found)


def _transitions(data: xr.Dataset, model: Model) -> list[Transition]:
    rows = series.transitions(data)
    if not len(rows):
        return []
    touching = {model.node_names[contact.node]: (-1, place) for place, contact in enumerate(model.contacts)}
    owners = touching | {name: (place, -1) for place, name in enumerate(model.string_names)}  # names are unique across kinds
    rest = zip(rows["string"], rows["time"], *(rows[part] for part in REST), strict=True)
    return [Transition(t, owners[name][0], b, a, lost, owners[name][1]) for name, t, b, a, lost in rest]


def _from_npz(path: Path, model: Model) -> Result:
    with np.load(path, allow_pickle=False) as stored:
        for kind in ("node", "bar", "string"):
            given, known = stored[f"{kind}_names"].tolist(), list(getattr(model, f"{kind}_names"))
            if given != known:
                raise _of_another(path, model, f"it has the {kind}s {', '.join(given)}, the scene has {', '.join(known)}")
        for field in outputs():
            if np.shape(stored[field.name])[1:] != full_shape(field, model):
                raise _of_another(path, model, f"its series {field.name!r} has another shape")
        transitions = [Transition(*row) for row in stored["transitions"].tolist()]
        return Result(stored["times"], transitions, {}, **{field.name: stored[field.name] for field in outputs()})


def _require_bars(path: Path, model: Model, result: Result) -> None:
    """Bars are rigid: a run of the model has them as long as they are there.  Raises InputError."""
    ends = result.position[:, model.bars]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1)
    wrong = np.flatnonzero(~(np.abs(length - model.bar_length) <= BAR_ERROR * model.bar_length).all(axis=0))
    if len(wrong):
        i = int(wrong[0])
        told = f"{model.bar_names[i]} is {length[0, i]:.6g} m long in it, {model.bar_length[i]:.6g} m in the scene"
        raise _of_another(path, model, told)


def _of_another(path: Path, model: Model, why: str) -> InputError:
    return InputError(
        f"{str(path)!r} is no run of {model.name}: {why}; name the scene that was simulated (tensegrity view: --scene SCENE)"
    )
