"""Results out of files that `tensegrity simulate` wrote, for a page that plays them back."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...fields import outputs
from ...model import Model, Result, Transition
from ...model.components import names, spread

#: Suffixes of such files.
SUFFIXES = (".csv", ".npz")


def result_of_file(path: Path, model: Model) -> Result:
    """The result of a .csv or .npz file of this model's run; a .csv file has no transitions.  Raises InputError."""
    try:
        return _from_csv(path, model) if path.suffix.lower() == ".csv" else _from_npz(path, model)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as failure:
        raise InputError(f"result = {str(path)!r} cannot be read: {failure}; write it anew: tensegrity simulate") from None


def _from_csv(path: Path, model: Model) -> Result:
    with path.open(encoding="utf-8", newline="") as file:
        header = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",", ndmin=2)
    columns = dict(zip(header, rows.T))
    wanted = {field.name: names(field, model) for field in outputs()}
    missing = [name for group in (["time"], *wanted.values()) for name in group if name not in columns]
    if missing or not len(rows):
        what = f"has no column {missing[0]!r} of {model.name}" if missing else "has no rows"
        raise InputError(f"result = {str(path)!r} {what}; name the scene that it is a run of: --scene SCENE")
    found = {}
    for field in outputs():
        flat = np.array([columns[name] for name in wanted[field.name]]).reshape(-1, len(rows)).T
        found[field.name] = spread(field, model, flat.astype(int) if field.compared == "count" else flat)
    return Result(columns["time"], (), {}, **found)


def _from_npz(path: Path, model: Model) -> Result:
    with np.load(path, allow_pickle=False) as stored:
        for kind in ("node", "bar", "string"):
            given, known = stored[f"{kind}_names"].tolist(), list(getattr(model, f"{kind}_names"))
            if given != known:
                problem = f"has the {kind}s {', '.join(given)}, {model.name} has {', '.join(known)}"
                raise InputError(f"result = {str(path)!r} {problem}; name the scene that it is a run of: --scene SCENE")
        transitions = [Transition(*row) for row in stored["transitions"].tolist()]
        return Result(stored["times"], transitions, {}, **{field.name: stored[field.name] for field in outputs()})
