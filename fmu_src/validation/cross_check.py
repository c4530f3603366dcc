"""Writes a cross-check bundle: a native FMU with inputs, reference results and options, after the rules of the FMI cross-check.

The scenario is the square wave of scenarios.py.  The results are the reference's, so an importer that reproduces them is
compared with an independent solution and not with this project's kernel.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

import tensegrity_core
from tensegrity_core import reference
from tensegrity_core.fields import outputs
from tensegrity_core.files import replacing_folder, write_text
from tensegrity_core.model import Model, Result
from tensegrity_core.model.components import flattened
from tensegrity_core.progress import Told

from ..packing.libraries import here
from ..packing.native_fmu import pack_native_fmu
from ..variables.described import plain
from ..variables.interface import Variable, variables
from .reference_cache import cached, reference_key
from .scenarios import Scenario, scenarios
from .validate import SETTINGS, input_values

#: The exporting tool's name in the folders of the cross-check.
TOOL = "tensegrity-fmu"
#: Simulated time and communication step, s: the rules want files of less than 1 MB.
DURATION, STEP = 2.0, 0.01
#: Of the options file; the tolerance is for importers that integrate themselves.
TOLERANCE = 1e-6

README = """{name}: {title}
Exported by {tool} {version} for FMI 2.0 co-simulation, {platform}. No licence key, no other software needed.

{name}_in.csv   all inputs, held constant between the rows; at a jump there are two rows.
{name}_ref.csv  all outputs, SI units, at communication steps of {step:g} s, by an independent integration of the equations.
{name}_ref.opt  start and stop time, step and tolerance.

Inputs change at communication points only: use the step of the options file.
"""


def write_cross_check(
    model: Model, folder: Path, naming: str = "structured", cache: Path | None = None, told: Told | None = None, **contents
) -> Path:
    """Write folder/fmus/2.0/cs/PLATFORM/TOOL/VERSION/NAME with the five files; returns it.

    naming, contents: of the FMU, see native_fmu.Contents; cache: of reference runs; told: of the reference.  Takes the
    reference's time for 2 s of motion.  Raises TensegrityError where the reference cannot go on or the FMU cannot be packed.
    """
    place = folder / "fmus" / "2.0" / "cs" / here() / TOOL / tensegrity_core.__version__ / model.name
    run = next(run for run in scenarios(model, DURATION, STEP) if run.name == "square_wave_1d")
    key = reference_key(run.model, run.inputs, SETTINGS)
    result, _ = cached(cache, key, lambda: reference.simulate(run.model, run.inputs, **SETTINGS, told=told))
    table = variables(model, naming)
    table = plain(table) if contents.get("simple") else table
    texts = {
        f"{model.name}_in.csv": table_of(*inputs_of(table, run)),
        f"{model.name}_ref.csv": table_of(*outputs_of(table, model, result)),
        f"{model.name}_ref.opt": options_of(run.inputs.times),
        "ReadMe.txt": readme_of(model, run),
    }
    with replacing_folder(place) as fresh:
        pack_native_fmu(model, fresh / f"{model.name}.fmu", naming, **contents)
        for name, text in texts.items():
            write_text(fresh / name, text)
    return place


def inputs_of(table: tuple[Variable, ...], run: Scenario) -> tuple[list[str], list[np.ndarray]]:
    """Names of all inputs, and rows (time, values): start, end, and two rows at each jump."""
    values, times = input_values(table, run), run.inputs.times
    found = [np.array([times[0], *values[0]])]
    for k in range(1, len(values)):
        if np.any(values[k] != values[k - 1]):
            found += [np.array([times[k], *values[k - 1]]), np.array([times[k], *values[k]])]
    return [row.name for row in table if row.causality == "input"], [*found, np.array([times[-1], *values[-1]])]


def outputs_of(table: tuple[Variable, ...], model: Model, result: Result) -> tuple[list[str], list[np.ndarray]]:
    """Names of all outputs in the order of the variable table, and rows (time, values) of the reference."""
    present = {row.field for row in table}
    fields = [field for field in outputs() if field.name in present]
    columns = [result.times[:, None], *(flattened(field, model, result.outputs[field.name]) for field in fields)]
    return [row.name for row in table if row.causality == "output"], list(np.hstack(columns))


def table_of(names: list[str], rows: list[np.ndarray]) -> str:
    """A CSV text whose first column is the time."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *names])
    writer.writerows([[f"{x:.10g}" for x in row] for row in rows])
    return out.getvalue()


def options_of(times: np.ndarray) -> str:
    """Lines of name and number; nothing else may stand in this file."""
    step = (times[-1] - times[0]) / (len(times) - 1)
    options = {"StartTime": times[0], "StopTime": times[-1], "StepSize": step, "RelTol": TOLERANCE}
    return "".join(f"{name}, {value:.12g}\n" for name, value in options.items())


def readme_of(model: Model, run: Scenario) -> str:
    version = tensegrity_core.__version__
    return README.format(name=model.name, title=run.title, tool=TOOL, version=version, platform=here(), step=STEP)
