"""A run as named, united series: an xarray Dataset with the FMU's names, and its files.

Dimension `time` (s).  Each variable has the attributes `units` (as UDUNITS writes them) and `long_name`.  Transitions are the
variables `transition.time`, `.string`, `.before`, `.after` and `.loss` along a dimension of their own.  The attributes of the
Dataset say what was run: scene, method, tolerance, version.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from .. import __version__
from ..errors import InputError
from ..fields import outputs
from ..files import replacing
from ..model import Model, Result
from ..model.components import flattened, named
from .export import require_writable


class _Part(NamedTuple):
    """Of a transition.  kind: of its values."""

    unit: str
    meaning: str
    kind: type


class BadSeries(ValueError):
    """What is wrong with a table or a file of series, in words for who wrote it."""


TRANSITION = {
    "time": _Part("s", "when a string changed its piece", float),
    "string": _Part("", "name of the string, or of the node that touches the ground", str),
    "before": _Part("1", "piece before, 0: slack; of a node 0: apart, 1: sticking, 2: slipping, 3: clipped", np.int32),
    "after": _Part("1", "piece after", np.int32),
    "loss": _Part("J", "energy that the snap lost", float),
}


def dataset(model: Model, result: Result, **attributes: Any) -> xr.Dataset:
    """attributes: what else is known of the run, text or numbers."""
    variables: dict[str, Any] = {}
    for field in outputs():
        told = {"units": udunits(field.unit), "long_name": field.meaning}
        values = flattened(field, model, result.outputs[field.name])
        for name, place in named(field, model).items():
            variables[name] = ("time", np.ascontiguousarray(values[:, place]), told)
    for name, part in TRANSITION.items():
        found = [t.name(model) if name == "string" else getattr(t, name) for t in result.transitions]
        told = {"long_name": part.meaning} | ({"units": part.unit} if part.unit else {})
        variables[f"transition.{name}"] = ("transition", np.array(found, dtype=part.kind), told)
    times = {"time": ("time", result.times, {"units": "s", "long_name": "time"})}
    known = {"scene": model.name, "description": model.description, "version": __version__, **attributes}
    known |= {f"statistics.{name}": int(count) for name, count in result.stats.items()}
    return xr.Dataset(variables, times, known)


def udunits(unit: str) -> str:
    """A unit of fields.py as UDUNITS writes it: m/s2 is m s-2."""
    above, *below = unit.split("/")
    return " ".join(
        [*above.split("."), *(re.sub(r"(\d*)$", lambda power: f"-{power[1] or 1}", part, count=1) for part in below)]
    )


def transitions(data: xr.Dataset) -> pd.DataFrame:
    """A row a transition: time (s), string, before, after, loss (J)."""
    return pd.DataFrame({part: data[f"transition.{part}"].values for part in TRANSITION if f"transition.{part}" in data})


def write(data: xr.Dataset, path: str | Path) -> Path:
    """Write a Dataset as .nc (NetCDF 3), .parquet or .csv (without units and transitions), whole or not at all.

    Raises InputError where that cannot be written.
    """
    path = require_writable(path, tuple(WRITERS))
    content = WRITERS[path.suffix.lower()](data)
    with replacing(path) as file:
        file.write(content)
    return path


def read(path: str | Path) -> xr.Dataset:
    """A Dataset out of a file of `write`, or out of any CSV file with a column `time` (s).  Raises InputError."""
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: only {', '.join(READERS)} files can be read; name one")
    try:
        with path.open("rb"):  # what the system says of it, before a library does
            pass
        data = reader(path)
        if data["time"].dtype.kind not in "iuf" or " since " in str(data["time"].attrs.get("units", "")):
            raise BadSeries("its times are dates; give seconds since the start, as numbers")
        return data
    except BadSeries as failure:
        raise InputError(f"{path}: {failure}") from failure
    except InputError:
        raise
    except Exception as failure:
        if isinstance(failure, UnicodeDecodeError) and path.suffix.lower() == ".csv":
            raise InputError(f"{path} is not UTF-8 text; save it as UTF-8") from None
        if isinstance(failure, OSError) and failure.errno:
            raise InputError(f"{path} cannot be read: {failure.strerror}; name another file") from failure
        raise InputError(
            f"{path} is no {FORMATS[path.suffix.lower()]} file, or a damaged one; write it anew, or name another file"
        ) from failure


def _netcdf(data: xr.Dataset) -> bytes:
    """NetCDF 3, which SciPy writes; its names take no brackets well everywhere, but readers keep them."""
    return bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def _columns(data: xr.Dataset) -> pd.DataFrame:
    return pd.DataFrame({"time": data["time"].values} | {str(n): v.values for n, v in data.items() if v.dims == ("time",)})


def _csv(data: xr.Dataset) -> bytes:
    return _columns(data).to_csv(index=False, lineterminator="\n").encode()


def _arrow() -> Any:
    """Raises InputError where pyarrow is missing."""
    try:
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise InputError("Parquet files need pyarrow, which is not installed: pip install pyarrow") from None
    return pyarrow


def _parquet(data: xr.Dataset) -> bytes:
    """A column a series; units and transitions in the file's metadata, as JSON."""
    arrow, into = _arrow(), io.BytesIO()
    table = arrow.Table.from_pandas(_columns(data), preserve_index=False)
    told = {
        "attributes": data.attrs,
        "series": {str(name): variable.attrs for name, variable in data.variables.items()},
        "transitions": transitions(data).to_dict("list"),
    }
    arrow.parquet.write_table(table.replace_schema_metadata({b"tensegrity": json.dumps(told).encode()}), into)
    return into.getvalue()


def _from_netcdf(path: Path) -> xr.Dataset:
    with path.open("rb") as file:
        if file.read(3) != b"CDF":
            raise BadSeries("it is no NetCDF 3 file; write it by to_netcdf(..., engine='scipy')")
    with xr.open_dataset(path, engine="scipy", decode_times=False) as data:
        if "time" not in data:
            raise BadSeries(f"it has no variable `time`, but {', '.join(map(str, data.variables))}")
        return data.load()


def _from_csv(path: Path) -> xr.Dataset:
    """Fields as texts: pandas reads numbers fast, and not to the last bit.  Raises BadSeries."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file, skipinitialspace=True) if any(map(str.strip, row))]
    header = [name.strip() for name in rows[0]] if rows else []
    if len(header) == 1 and ";" in header[0]:
        raise BadSeries("its columns are separated by semicolons; separate them with commas, and write decimals with points")
    for i, name in enumerate(header):
        if not name or name in header[:i]:
            raise BadSeries(f"column {name} stands twice; name it once" if name else f"column {i + 1} has no name; give it one")
    if len(rows) < 2:
        raise BadSeries("it has no rows of numbers; give a header and at least one row")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise BadSeries(f"row {number} has {len(row)} values, the header {len(header)} names; give one value for each name")
    return from_frame(pd.DataFrame({name: _numbers(name, texts) for name, texts in zip(header, zip(*rows[1:]))}))


def _numbers(name: str, texts: Iterable[str]) -> np.ndarray:
    """Raises BadSeries for what is no finite number."""
    found = []
    for row, text in enumerate(texts, 2):
        try:
            found.append(float(text))
        except ValueError:
            found.append(np.nan)
        if not np.isfinite(found[-1]):
            raise BadSeries(f"row {row}, column {name}: {text!r} is not a finite number; give one, or leave the row out")
    return np.array(found)


def from_frame(table: pd.DataFrame) -> xr.Dataset:
    """A Dataset of a table's columns, over its column or its index `time`, s.  Raises BadSeries where it has none."""
    if "time" not in table and table.index.name == "time":
        table = table.reset_index()
    if "time" not in table:
        raise BadSeries(f"it has no column `time`, but {', '.join(map(str, table))}")
    series = {str(name): ("time", table[name].to_numpy()) for name in table if name != "time"}
    return xr.Dataset(series, {"time": ("time", table["time"].to_numpy())})


def _from_parquet(path: Path) -> xr.Dataset:
    table = _arrow().parquet.read_table(path)
    told = json.loads((table.schema.metadata or {}).get(b"tensegrity", b"{}"))
    data = from_frame(table.to_pandas())
    for part, values in told.get("transitions", {}).items():
        data[f"transition.{part}"] = ("transition", np.array(values, dtype=TRANSITION[part].kind))
    for name, attributes in told.get("series", {}).items():
        if name in data.variables:
            data[name].attrs = attributes
    return data.assign_attrs(told.get("attributes", {}))


WRITERS: dict[str, Callable[[xr.Dataset], bytes]] = {".nc": _netcdf, ".parquet": _parquet, ".csv": _csv}
READERS: dict[str, Callable[[Path], xr.Dataset]] = {".nc": _from_netcdf, ".parquet": _from_parquet, ".csv": _from_csv}
FORMATS = {".nc": "NetCDF 3", ".parquet": "Parquet", ".csv": "CSV"}
