"""Writes cross-check bundles: a native FMU with inputs, reference results and options, after the rules of the FMI cross-check.

The scenario is the square wave of scenarios.py.  The results are the reference's, so an importer that reproduces them is
compared with an independent solution and not with this project's kernel.
"""

from __future__ import annotations

import csv
import io
from itertools import pairwise
from pathlib import Path

import numpy as np

import tensegrity_core
from tensegrity_core import reference
from tensegrity_core.fields import outputs
from tensegrity_core.files import replacing_folder, write_text
from tensegrity_core.model import Model, Result
from tensegrity_core.model.components import flattened, present
from tensegrity_core.progress import Told

from ..packing.libraries import TUPLES, here
from ..packing.native_fmu import Contents, libraries_of, native_fmu_files
from ..packing.pack import EXCHANGE_TOLERANCE, write_zip
from ..variables.arrays import Whole, wholes
from ..variables.described import plain
from ..variables.interface import Variable, variables
from ..variables.states import LEFT_OUT
from .reference_cache import cached, reference_key
from .scenarios import Scenario, scenarios
from .validate import SETTINGS, input_values

#: The exporting tool's name in the folders of the cross-check.
TOOL = "tensegrity-fmu"
#: Simulated time and communication step, s: the rules want files of less than 1 MB.
DURATION, STEP = 2.0, 0.01
#: Of the options file, by kind. An FMU that integrates itself takes no looser one than its own.
TOLERANCE = {"cs": 1e-6, "me": EXCHANGE_TOLERANCE}

#: What a replay may differ by, in terms of 1 + the largest value of an output.
CLOSE = 2e-5

KINDS = {"cs": "co-simulation", "me": "model exchange"}

README = """{name}: {title}
Exported by {tool} {version} for FMI {standard} {kind}, {platform}. No licence key, no other software needed.

{name}_in.csv   all inputs, held constant between the rows; at a jump there are two rows.
{name}_ref.csv  all outputs, SI units, at communication steps of {step:g} s, by an independent integration of the equations.
{name}_ref.opt  start and stop time, step and tolerance.

Inputs change at communication points only: use the step of the options file. Outputs are within {close:g} of 1 + their largest
value{but}.
"""


#: Of model exchange, where outputs depend on inputs at once.
BEFORE = """. Where inputs jump, the row holds the values before the jump, which in a host that keeps
both are those of the first of two rows"""


def write_cross_check(
    model: Model, folder: Path, naming: str = "structured", cache: Path | None = None, told: Told | None = None, **contents
) -> list[Path]:
    """Write folder/fmus/VERSION/KIND/PLATFORM/TOOL/VERSION/NAME with the five files, for each kind that the FMU is of; returns
    them.

    naming, contents: of the FMU, see native_fmu.Contents; cache: of reference runs; told: of the reference.  Takes the
    reference's time for 2 s of motion.  Raises TensegrityError where the reference cannot go on or the FMU cannot be packed.
    """
    chosen = Contents(naming, **contents)
    run = next(run for run in scenarios(model, DURATION, STEP) if run.name == "square_wave_1d")
    key = reference_key(run.model, run.inputs, SETTINGS)
    result, _ = cached(cache, key, lambda: reference.simulate(run.model, run.inputs, **SETTINGS, told=told))
    kinds = [kind for kind in KINDS if chosen.kind in (kind, "both")]
    return [_written(model, folder, chosen, kind, run, result) for kind in kinds]


def _written(model: Model, folder: Path, chosen: Contents, kind: str, run: Scenario, result: Result) -> Path:
    """The bundle of one kind."""
    fmi3, exported = chosen.standard == "3.0", tensegrity_core.__version__
    platform = TUPLES.get(here(), here()) if fmi3 else here()
    place = folder / "fmus" / chosen.standard / kind / platform / TOOL / exported / model.name
    table = variables(model, chosen.naming)
    table = plain(table) if chosen.simple else table
    if chosen.kind != "cs":
        table = tuple(row for row in table if row.field not in LEFT_OUT)
    texts = {
        f"{model.name}_in.csv": table_of(*inputs_of(table, run), fmi3),
        f"{model.name}_ref.csv": table_of(*outputs_of(table, model, result), fmi3),
        f"{model.name}_ref.opt": options_of(run.inputs.times, kind),
        "ReadMe.txt": readme_of(model, run, chosen.standard, kind, platform),
    }
    with replacing_folder(place) as fresh:
        write_zip(fresh / f"{model.name}.fmu", native_fmu_files(model, chosen, libraries_of(chosen)))
        for name, text in texts.items():
            write_text(fresh / name, text)
    return place


def inputs_of(table: tuple[Variable, ...], run: Scenario) -> tuple[list[Variable], list[np.ndarray]]:
    """All inputs, and rows (time, values): start, end, and two rows at each jump."""
    values, times = input_values(table, run), run.inputs.times
    found = [np.array([times[0], *values[0]])]
    for k in range(1, len(values)):
        if np.any(values[k] != values[k - 1]):
            found += [np.array([times[k], *values[k - 1]]), np.array([times[k], *values[k]])]
    return [row for row in table if row.causality == "input"], [*found, np.array([times[-1], *values[-1]])]


def outputs_of(table: tuple[Variable, ...], model: Model, result: Result) -> tuple[list[Variable], list[np.ndarray]]:
    """All outputs in the order of the variable table, and rows (time, values) of the reference."""
    known = {row.field for row in table}
    fields = [field for field in outputs() if field.name in known]
    values = (flattened(field, model, result.outputs[field.name])[:, present(field, model)] for field in fields)
    columns = [result.times[:, None], *values]
    return [row for row in table if row.causality == "output"], list(np.hstack(columns))


def table_of(columns: list[Variable], rows: list[np.ndarray], fmi3: bool = False) -> str:
    """A CSV text whose first column is the time; fmi3: an array is one column, with blanks between its elements."""
    found = wholes(columns) if fmi3 else [Whole(row.name, "", (row,), False) for row in columns]
    ends = np.cumsum([1, *(len(one.rows) for one in found)])
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *(one.name for one in found)])
    for row in rows:
        texts = [f"{x:.10g}" for x in row]
        writer.writerow([texts[0], *(" ".join(texts[i:j]) for i, j in pairwise(ends))])
    return out.getvalue()


def options_of(times: np.ndarray, kind: str) -> str:
    """Lines of name and number; nothing else may stand in this file."""
    step = (times[-1] - times[0]) / (len(times) - 1)
    options = {"StartTime": times[0], "StopTime": times[-1], "StepSize": step, "RelTol": TOLERANCE[kind]}
    return "".join(f"{name}, {value:.12g}\n" for name, value in options.items())


def readme_of(model: Model, run: Scenario, standard: str, kind: str, platform: str) -> str:
    but = BEFORE if kind == "me" else "; energy.throughput, whose integrand has kinks, within five times that"
    known = {"standard": standard, "kind": KINDS[kind], "platform": platform, "close": CLOSE, "but": but}
    known |= {"name": model.name, "title": run.title, "tool": TOOL, "version": tensegrity_core.__version__, "step": STEP}
    return README.format(**known)
