"""The scenario that every importer runs, what it is compared with, and the FMUs it needs."""

from __future__ import annotations

import subprocess
from functools import partial
from pathlib import Path

import numpy as np
from fmpy import read_model_description

from fmu_src.packing.libraries import here
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu, write_zip
from fmu_src.validation.reference_cache import cached, reference_key
from fmu_src.validation.scenarios import LIFT, pushed_node
from fmu_src.validation.validate import CACHE, SETTINGS
from fmu_src.variables.arrays import wholes
from fmu_src.variables.interface import variables
from tensegrity_core import kernel, reference
from tensegrity_core.article.experiments import top_nodes
from tensegrity_core.model import Inputs, Model, grid, held
from tensegrity_core.native import build
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

from .tools import ME, THREE, THREE_ME

HERE = Path(__file__).resolve().parent
SCENE = "three_bar_nsh"
#: Simulated time and communication step, s; half height, N, and period, s, of the square wave.
DURATION, STEP, WAVE, PERIOD = 2.0, 0.01, 200.0, 1.0
#: How far positions may be off the reference, m.
POSITION_BOUND = 1e-7
SIMPLE = "{}, simple types".format
#: What packs an FMU; those with simple types are for tools that refuse the others.
PACK = {
    "native": pack_native_fmu,
    SIMPLE("native"): partial(pack_native_fmu, simple=True),
    "python": pack_python_fmu,
    SIMPLE("python"): partial(pack_python_fmu, simple=True),
    ME: partial(pack_native_fmu, kind="me"),
    THREE: partial(pack_native_fmu, standard="3.0"),
    THREE_ME: partial(pack_native_fmu, standard="3.0", kind="me"),
}
SOURCE = "square_wave"
#: What the page says of it.
SHOWN = {"scene": SCENE, "duration": DURATION, "step": STEP, "lift": LIFT, "wave": WAVE, "period": PERIOD}


def model() -> Model:
    return build_model(load_scene(SCENE))


def force(model: Model, t: float) -> np.ndarray:
    """(N, 3) N: a lift on every top node and the square wave on one of them."""
    out = np.zeros((len(model.nodes), 3))
    out[top_nodes(model), 2] = LIFT
    out[pushed_node(model), 2] = WAVE if t % PERIOD < 0.5 * PERIOD else -WAVE
    return out


def inputs(model: Model) -> Inputs:
    """Held over each step, as every importer here holds them (docs/importers.md says how each is brought to it)."""
    return held(model, grid(DURATION, STEP), lambda t: force(model, t))


def expected(model: Model) -> np.ndarray:
    """(K+1, N, 3) positions, m, of the reference under the same held inputs; kept like all reference runs."""
    moved = inputs(model)
    return cached(CACHE, reference_key(model, moved, SETTINGS), lambda: reference.simulate(model, moved, **SETTINGS))[
        0
    ].position


def plain_kernel(model: Model) -> np.ndarray:
    """(K+1, N, 3) positions, m, of the kernel called from Python under the same held inputs."""
    return kernel.simulate(model, inputs(model)).position


def job(model: Model, fmu: Path, source: Path, folder: Path) -> dict:
    """What a driver is told; see drivers/job.py."""
    table = variables(model)
    pushed, moved = pushed_node(model), inputs(model)
    lifted = [i for i in top_nodes(model) if i != pushed]
    described = read_model_description(str(fmu))
    return {
        "fmu": str(fmu),
        "standard": described.fmiVersion,
        "kind": "cs" if described.coSimulation else "me",
        "source": str(source),
        "source_outputs": {"wave": 0, "lift1": 1, "lift2": 2},
        "step": STEP,
        "constants": {f"{model.node_names[i]}.force.z": LIFT for i in lifted},
        "wave": f"{model.node_names[pushed]}.force.z",
        "values": moved.force[:, pushed, 2].tolist(),
        "outputs": [row.name for row in table if row.field == "position"],
        "references": {variable.name: variable.valueReference for variable in described.modelVariables},
        "arrays": arrays(model) if described.fmiVersion == "3.0" else {},
        "starts": {row.name: row.start for row in table if row.causality == "input"},
        "folder": str(folder),
    }


def arrays(model: Model) -> dict[str, tuple[str, int, int]]:
    """Of the elements of FMI 3.0's arrays: the array's name, the place in it and its size."""
    found = {}
    for whole in wholes(variables(model)):
        for place, row in enumerate(whole.rows if whole.is_array else ()):
            found[row.name] = (whole.name, place, len(whole.rows))
    return found


def pack_source(destination: Path) -> Path:
    """The FMU whose outputs are the wave and the lift, compiled here.  Raises RuntimeError without a C compiler."""
    command = build.system_compiler() or build.zig()
    library = destination.with_suffix(Path(build.FMU_LIBRARY).suffix)
    values = [f"-DHEIGHT={WAVE}", f"-DPERIOD={PERIOD}", f"-DLIFT={LIFT}"]
    options = ["-O2", "-shared", "-fPIC", *values, f"-I{build.fmi_headers()}"]
    destination.parent.mkdir(parents=True, exist_ok=True)
    line = [*command, *options, str(HERE / "source.c"), "-o", str(library), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"source.c could not be compiled: {done.stderr[-1000:]}")
    binary = f"binaries/{here()}/{SOURCE}{library.suffix}"
    write_zip(destination, {"modelDescription.xml": (HERE / "source.xml").read_bytes(), binary: library.read_bytes()})
    return destination
