"""Everything that the scenes do, recorded at one commit and compared at another: for changes that must change nothing.

`python -m tests.support.recorded record FILE.npz` runs the six scenes and those of docs/drives.md and docs/memory.md: statics,
force laws, the kernel under every method, the reference, both FMUs through FMI's calls.
`python -m tests.support.recorded compare FILE.npz`
runs them again, here or in another checkout, prints one line for each group, and ends with 1 where a group differs by more than
it may: by nothing at all, or, on paths and where strings have parts in series, by what round-off explains (see `ROOM`).
Messages are not recorded, nor the bytes of saved states: that a restored state goes on alike is.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from tensegrity_core import kernel, reference
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.modes import modes
from tensegrity_core.equilibria.steady_states import load_sweep
from tensegrity_core.errors import TensegrityError
from tensegrity_core.fields import METHODS
from tensegrity_core.model import Inputs, Model, held
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model

ROOT = next(folder for folder in Path(__file__).resolve().parents if (folder / "pyproject.toml").is_file())
PAGES = ("drives.md", "memory.md")
SCENE = re.compile(r"^```toml\n# (\w+)\.toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)

#: Simulated time, s, of a run of the kernel, of the reference, and of an FMU.
KERNEL_TIME, REFERENCE_TIME, FMU_TIME = 3.0, 0.4, 1.0
#: Communication steps, s, in turn.
STEPS = (0.01, 0.004, 0.02)
SEED = 12
#: Options of methods beside their defaults: at 1 ms rk4 is unstable on the six-bar scenes.
OPTIONS = {"rk4": {"max_step": 2.5e-4}}
#: Methods of the FMUs' runs.
FMU_METHODS = ("auto", "rodas5p")
#: How far an FMU's inputs go from their start values, by unit.
AMPLITUDES = {"N": 20.0, "m": 0.003, "m/s": 0.02, "m/s2": 0.3, "A": 0.2}

#: Where strings have parts in series: what lengths (m) may differ by, and times of transitions (s) and all else, relative to
#: the largest value of the group's entry: an error of 1e-11 m of an elongation of 1e-3 m, and of what grows with it.
#: A path has the same room: its points are Newton's, right up to round-off, in which the order of a sum shows.
ROOM, RELATIVE = 1e-11, 1e-8
LENGTHS = ("position", "string_length", "rest_length", "nodes", "wound_rest_length", "breakpoints", "m")
#: Integrals of a power's absolute value, whose kinks no step ends at, and difference quotients, relative likewise.
ROUGH, ROUGHLY = ("throughput", "J", "rates", "derivatives"), 1e-6
#: Entries that count the solver's work: where strings have parts in series they are shown and not judged.
WORK = ("stats",)

Record = dict[str, np.ndarray]


class Difference(NamedTuple):
    """What became of an entry: name; size of the difference (inf: not comparable, with why); whether it may be."""

    name: str
    size: float
    allowed: bool
    why: str = ""


# --- scenes and inputs ---------------------------------------------------------------------------------------------


def page_scenes(folder: Path) -> dict[str, Path]:
    """Scene files out of the pages' blocks, written into a folder: name -> file."""
    found = {}
    for page in PAGES:
        for name, text in SCENE.findall((ROOT / "docs" / page).read_text(encoding="utf-8")):
            found[name] = folder / f"{name}.toml"
            found[name].write_text(text, encoding="utf-8")
    return found


def uneven(duration: float) -> np.ndarray:
    """(K+1,) communication points of uneven steps, s."""
    count = round(duration / sum(STEPS)) * len(STEPS)
    return np.concatenate(([0.0], np.cumsum(np.resize(STEPS, count))))


def history(model: Model, duration: float) -> Inputs:
    """Random held forces on all free nodes, swaying rest lengths of which the first jumps, swaying currents and moved nodes."""
    random, times = np.random.default_rng(SEED), uneven(duration)
    forces = np.zeros((8, len(model.nodes), 3))
    free, axes = list(model.free_nodes), list(model.axes)
    forces[np.ix_(range(8), free, axes)] = random.normal(0.0, 25.0, (8, len(free), len(axes)))
    forces[4, free, 2] += 45.0
    phase = random.uniform(0.0, 6.0, len(model.strings))
    along = np.zeros((len(model.moving), 3))
    along[:, axes] = 0.02
    given = held(
        model,
        times,
        force=lambda t: forces[int(8.0 * t / times[-1]) % 8],
        rest_length=lambda t: model.rest_length * (1.0 + 0.02 * (np.sin(9.0 * t + phase) - np.sin(phase))),
        current=lambda t: model.current + 0.3 * np.sin(7.0 * t),
        drum_load=lambda t: np.full(len(model.actuated), 2.0 * (t > 0.5 * times[-1])),
        motion=lambda t: (model.nodes[list(model.moving)] + along * (1.0 - np.cos(12.0 * t)), along * 12.0 * np.sin(12.0 * t)),
    )
    lengths = given.rest_length.copy()
    lengths[len(lengths) // 2 :, 0] *= 0.985
    return replace(given, rest_length=lengths).resolved(model)


# --- what is recorded ----------------------------------------------------------------------------------------------


def statics(model: Model) -> Record:
    """The start as it was computed, and the modes there."""
    record = {name: np.asarray(getattr(model, name)) for name in ("nodes", "rest_length", "current", "stiffness", "damping")}
    found = modes(model)
    record["eigenvalues"] = np.array([mode.eigenvalue for mode in found])
    record["shapes"] = np.array([mode.shape for mode in found])
    return record


def path(model: Model) -> Record:
    """The steady states under a slow lift of the top nodes and back."""
    lift = np.zeros((len(model.nodes), 3))
    top = [node for node in model.free_nodes if model.nodes[node, 2] > model.nodes[model.free_nodes, 2].max() - 0.01]
    lift[top, 2] = 1.0
    sweep = load_sweep(Loading(model, lift), [*range(0, 31, 5), *range(25, -1, -5)])
    tension = np.array([state.tension for state in sweep.states])
    return {"nodes": sweep.nodes, "tension": tension, "jumps": np.array([jump.kind for jump in sweep.jumps], dtype=str)}


def curves(model: Model) -> Record:
    """Tension, stiffness, energy and piece of every string over elongations from slack to 15 cm, and its breakpoints."""
    simulation = kernel.Kernel(model)
    elongations = np.linspace(-0.0103, 0.1517, 161)  # none on a breakpoint
    rows = [[simulation.string_law(string, x) for x in elongations] for string in range(len(model.strings))]
    breakpoints = [simulation.breakpoints(string) for string in range(len(model.strings))]
    found = np.array(rows, dtype=float)
    return {
        "tension": found[:, :, 0],
        "stiffness": found[:, :, 1],
        "energy": found[:, :, 2],
        "piece": found[:, :, 3].astype(int),
        "breakpoints": np.concatenate(breakpoints),
    }


def trajectory(simulate: Callable, model: Model, duration: float, **options) -> Record:
    """All series of a run, its transitions and its counters."""
    result = simulate(model, history(model, duration), **options)
    record = {"times": result.times, **result.outputs}
    record["transitions.time"] = np.array([one.time for one in result.transitions])
    record["transitions.loss"] = np.array([one.loss for one in result.transitions])
    found = [(one.string, one.before, one.after) for one in result.transitions]
    record["transitions.pieces"] = np.array(found, dtype=int).reshape(-1, 3)
    return record | {f"stats.{name}": np.array(value) for name, value in result.stats.items()}


def inside(model: Model, method: str, **options) -> Record:
    """The kernel's own calls after a short run: state, rates of the outputs, right-hand side, Jacobian, a restored state."""
    simulation, given = kernel.Kernel(model, method=method, **options), kernel.input_rows(model, history(model, 0.4))
    block = simulation.values[: given.shape[1]]
    block[:] = given[0]
    simulation.initialize(0.0)
    for row in given:
        block[:] = row
        simulation.step(0.01)
    saved, record = simulation.save(), {"state": simulation.state, "rates": simulation.output_rates()}
    record["derivative"] = simulation.derivative(record["state"])
    record |= dict(zip(("jacobian.position", "jacobian.velocity", "jacobian.time"), simulation.jacobian(record["state"])))
    simulation.step(0.02)
    record["values"] = simulation.values.copy()
    simulation.restore(saved)
    if all(nsh is None or nsh.law != "hysteretic" for nsh in model.nsh):  # with memory it is fixed
        simulation["stiffness"][:] *= 1.1
    simulation["damping"][:] *= 0.7
    simulation.slopes[0, : len(simulation["force"])] = 0.5  # N/s; forces lead
    simulation.step(0.02)
    return record | {"values.tuned": simulation.values.copy()}


# --- FMUs ----------------------------------------------------------------------------------------------------------


class Instance:
    """An FMU's instance by fmpy's calls; `answers` collects what they give: name -> rows."""

    def __init__(self, folder: str, description):
        self.variables = description.modelVariables
        self.answers: dict[str, list] = {}
        self._log = fmi2CallbackLoggerTYPE(lambda *message: None)
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="recorded",
        )
        self.fmu.instantiate(callbacks=fmi2CallbackFunctions(logger=self._log))

    def chosen(self, kind: str, **having) -> list:
        """Variables of a type with these attributes."""
        return [v for v in self.variables if v.type == kind and all(getattr(v, key) == value for key, value in having.items())]

    def note(self, name: str, values) -> None:
        self.answers.setdefault(name, []).append(np.array(values))

    def outputs(self, name: str) -> None:
        """Note all outputs, those of each unit together."""
        reals = self.chosen("Real", causality="output")
        for unit in dict.fromkeys(v.unit for v in reals):
            self.note(f"{name}.{unit}", self.fmu.getReal([v.valueReference for v in reals if v.unit == unit]))
        whole = self.chosen("Integer", causality="output")
        if whole:
            self.note(f"{name}.integer", self.fmu.getInteger([v.valueReference for v in whole]))

    def status(self, name: str, call: Callable, *arguments) -> None:
        """Note the status of a call that may be refused."""
        try:
            call(*arguments)
            self.note(name, 0)
        except FMICallException as refused:
            self.note(name, refused.status)

    def drive(self, random: np.random.Generator) -> None:
        """Set every input to somewhere about its start value."""
        inputs = self.chosen("Real", causality="input")
        away = random.uniform(-1.0, 1.0, len(inputs))
        values = [float(v.start or 0.0) + AMPLITUDES[v.unit] * part for v, part in zip(inputs, away)]
        self.fmu.setReal([v.valueReference for v in inputs], values)

    def begin(self, method: str) -> None:
        """Up to the first step."""
        (chooser,) = [v for v in self.variables if v.name == "solver.method"]
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.setInteger([chooser.valueReference], [METHODS.index(method)])
        self.fmu.enterInitializationMode()
        self.outputs("start")
        self.drive(np.random.default_rng(SEED))
        self.outputs("start")
        self.fmu.exitInitializationMode()

    def walk(self, name: str, times: np.ndarray, random: np.random.Generator) -> None:
        """Steps between the times, under other inputs every fifth step."""
        for k, (time, end) in enumerate(pairwise(times)):
            if k % 5 == 0:
                self.drive(random)
            self.status(f"{name}.status", self.fmu.doStep, float(time), float(end - time))
            self.outputs(name)

    def derivatives(self, name: str) -> None:
        """Note the first derivatives of all outputs."""
        outputs = [v.valueReference for v in self.chosen("Real", causality="output")]
        self.note(name, self.fmu.getRealOutputDerivatives(outputs, [1] * len(outputs)))

    def tune(self, factor: float) -> None:
        """Multiply all tunable parameters."""
        references = [v.valueReference for v in self.chosen("Real", variability="tunable")]
        self.fmu.setReal(references, [factor * value for value in self.fmu.getReal(references)])

    def slopes(self, slope: float) -> None:
        """Let all forces change at a rate, N/s."""
        forces = [v.valueReference for v in self.chosen("Real", causality="input") if v.unit == "N"]
        self.fmu.setRealInputDerivatives(forces, [1] * len(forces), [slope] * len(forces))

    def run(self, method: str) -> None:
        """A life: steps, a state saved, left and restored from its bytes, tuning, input derivatives, refused calls, reset."""
        times, random = uneven(FMU_TIME), np.random.default_rng(SEED)
        middle, later = len(times) // 3, 2 * len(times) // 3
        self.begin(method)
        self.walk("first", times[: middle + 1], random)
        self.derivatives("first.derivatives")
        state = self.fmu.getFMUState()
        data = self.fmu.serializeFMUState(state)
        self.walk("left", times[middle : middle + 8], random)
        self.fmu.setFMUState(self.fmu.deserializeFMUState(data))
        self.outputs("restored")
        self.walk("second", times[middle : later + 1], random)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)
        self.tune(1.1)
        self.slopes(5.0)
        self.walk("tuned", times[middle:], random)
        self.refused(float(times[-1]))
        self.fmu.reset()
        self.begin("auto")
        self.walk("again", times[:6], np.random.default_rng(SEED))
        self.fmu.terminate()
        self.fmu.freeInstance()

    def refused(self, now: float) -> None:
        """A value and a step that are none; the last one ends the run."""
        force = next(v.valueReference for v in self.chosen("Real", causality="input"))
        self.status("refused", self.fmu.setReal, [force], [np.nan])
        self.outputs("after refusal")
        self.status("refused", self.fmu.doStep, now, -1.0)


def fmu_records(pack: Callable, model: Model, folder: Path) -> dict[str, Record]:
    """modelDescription.xml but for its GUID, and a life under each of FMU_METHODS."""
    file = pack(model, folder / f"{model.name}.fmu")
    unpacked = extract(str(file), unzipdir=str(folder / model.name))
    text = (Path(unpacked) / "modelDescription.xml").read_text(encoding="utf-8")
    records = {"description": {"xml": np.array(re.sub(r' (guid|generationDateAndTime)="[^"]*"', "", text))}}
    for method in FMU_METHODS:
        instance = Instance(unpacked, read_model_description(str(file)))
        instance.run(method)
        records[method] = {name: np.array(rows) for name, rows in instance.answers.items()}
    shutil.rmtree(unpacked, ignore_errors=True)  # Windows does not let go of loaded libraries
    return records


# --- recording -----------------------------------------------------------------------------------------------------


def or_refusal(part: Callable, *arguments, **options) -> Record:
    """What a part records; where the project refuses it, the kind of its refusal."""
    try:
        return part(*arguments, **options)
    except TensegrityError as refusal:
        return {"refused": np.array(f"{type(refusal).__name__} {getattr(refusal, 'status', '')}".strip())}


def groups(model: Model, folder: Path) -> Iterator[tuple[str, Record]]:
    """All that is recorded of a scene: name of the group, entries."""
    yield "statics", or_refusal(statics, model)
    yield "path", or_refusal(path, model)
    yield "curves", or_refusal(curves, model)
    for method in METHODS:
        options = {"method": method} | OPTIONS.get(method, {})
        yield f"kernel {method}", or_refusal(trajectory, kernel.simulate, model, KERNEL_TIME, **options)
        yield f"inside {method}", or_refusal(inside, model, **options)
    yield "reference", or_refusal(trajectory, reference.simulate, model, REFERENCE_TIME)
    for runtime, pack in (("native", pack_native_fmu), ("python", pack_python_fmu)):
        (folder / runtime).mkdir(exist_ok=True)
        for part, record in fmu_records(pack, model, folder / runtime).items():
            yield f"{runtime} FMU {part}", record


def in_series(model: Model) -> bool:
    """Whether the force curve of a string is that of parts in series, which is fitted."""
    return any(nsh is not None for nsh in model.nsh) or "Series(" in repr(model.element)


def recorded(names: list[str] | None = None, changed: Callable[[Model], Model] = lambda model: model) -> Iterator[tuple]:
    """(scene, whether strings have parts in series, group, entries) of the scenes of these names, by default all; changed: what
    is done to each model first."""
    with tempfile.TemporaryDirectory(prefix="recorded-") as temporary:
        scenes = {name: name for name in builtin_scenes()} | page_scenes(Path(temporary))
        for name in names or scenes:
            model = changed(build_model(load_scene(scenes[name])))
            for group, record in groups(model, Path(temporary)):
                yield name, in_series(model), group, record


def commit() -> str:
    done = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    return done.stdout.strip() or "unknown"


def save(file: Path, rows: Iterator[tuple]) -> None:
    """Write a recording: entries as `scene/group/name`, and JSON about them."""
    entries, fitted = {}, {}
    for scene, series, group, record in rows:
        fitted[scene] = series
        entries |= {f"{scene}/{group}/{name}": value for name, value in record.items()}
    about = {"commit": commit(), "numpy": np.__version__, "with NSH": fitted}
    partial = file.with_name(file.name + ".part")
    with partial.open("wb") as stream:
        np.savez_compressed(stream, about=np.array(json.dumps(about)), **entries)
    partial.replace(file)


def load(file: Path) -> tuple[dict, dict[tuple[str, str], Record]]:
    """What is said about a recording, and its groups: (scene, group) -> entries."""
    found: dict[tuple[str, str], Record] = {}
    with np.load(file, allow_pickle=False) as stored:
        for key in stored.files:
            if key != "about":
                scene, group, name = key.split("/", 2)
                found.setdefault((scene, group), {})[name] = stored[key]
        return json.loads(str(stored["about"])), found


# --- comparing -----------------------------------------------------------------------------------------------------


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    """Equal to the last bit, signs of zeros and kinds of NaN too."""
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def numbers_apart(text: np.ndarray) -> tuple[list[str], np.ndarray]:
    """A text without its decimal numbers, and these."""
    number = r"-?\d+\.\d+(?:e[-+]?\d+)?"
    return re.split(number, str(text)), np.array(re.findall(number, str(text)), dtype=float)


def compared(name: str, one: np.ndarray, other: np.ndarray, series: bool) -> Difference | None:
    """None where two entries are the same to the last bit."""
    if same_bits(one, other):
        return None
    if one.dtype.kind == "U" and other.dtype.kind == "U" and one.shape == other.shape == ():
        (words, one), (others, other) = numbers_apart(one), numbers_apart(other)
        if words != others:
            return Difference(name, np.inf, False, "another text")
    if one.shape != other.shape or one.dtype.kind != other.dtype.kind:
        why = f"{one.dtype} {one.shape}, was {other.dtype} {other.shape}"
        return Difference(name, np.inf, series and name.startswith(WORK), why)
    if one.dtype.kind not in "fciu":
        return Difference(name, np.inf, False, "other values")
    if not np.array_equal(np.isfinite(one), np.isfinite(other)):
        return Difference(name, np.inf, False, "other places that are not finite")
    finite = np.isfinite(one)
    size = float(np.max(np.abs(one[finite] - other[finite]), initial=0.0))
    return Difference(name, size, series and (name.startswith(WORK) or size <= room(name, one, other)))


def room(name: str, one: np.ndarray, other: np.ndarray) -> float:
    """By how much an entry may differ where strings have parts in series; whole numbers: not at all."""
    if one.dtype.kind in "iu":
        return 0.0
    kind = name.split(".")[-1]
    if kind in LENGTHS and not name.startswith("jacobian"):
        return ROOM
    return (ROUGHLY if kind in ROUGH else RELATIVE) * float(np.max(np.abs(other), initial=0.0, where=np.isfinite(other)))


def differences(one: Record, other: Record, series: bool) -> list[Difference]:
    """Entries of `one`, recorded now, that differ from those of `other`, recorded before."""
    lost = [Difference(name, np.inf, False, "is missing") for name in other if name not in one]
    new = [Difference(name, np.inf, False, "is new") for name in one if name not in other and np.size(one[name])]
    found = (compared(name, one[name], other[name], series) for name in one if name in other)
    return lost + new + [difference for difference in found if difference]


def verdict(found: list[Difference]) -> str:
    """What a group's line says."""
    if not found:
        return "identical bits"
    largest = max(found, key=lambda one: (not one.allowed, not one.name.startswith(WORK), one.size))
    names = ", ".join(f"{one.name} {one.why or format(one.size, '.1e')}" for one in found)
    return f"{'differs by at most' if largest.allowed else 'DIFFERS by'} {largest.size:.1e} ({largest.name}): {names}"


def compare(before: Path, rows: Iterator[tuple]) -> bool:
    """Print a line for each group; whether nothing differs by more than it may."""
    about, known = load(before)
    print(f"compared with {about['commit']}")
    fine, kinds = True, {scene for scene, _ in known}
    seen = set()
    for scene, series, group, record in rows:
        if scene not in kinds:
            continue
        seen.add((scene, group))
        found = differences(record, known.get((scene, group), {}), series or about["with NSH"][scene] or group == "path")
        fine &= all(one.allowed for one in found)
        print(f"{scene:<16}{group:<24}{verdict(found)}", flush=True)
    for scene, group in sorted(set(known) - seen):
        print(f"{scene:<16}{group:<24}was not recorded again")
    return fine and seen == set(known)


def stored(file: Path) -> Iterator[tuple]:
    """A recording's groups as `recorded` yields them."""
    about, found = load(file)
    for (scene, group), record in found.items():
        yield scene, about["with NSH"][scene], group, record


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("record", "compare"))
    parser.add_argument("file", type=Path, metavar="FILE.npz", help="the recording to write, or to compare with")
    parser.add_argument("other", type=Path, metavar="OTHER.npz", nargs="?", help="compare: a second recording instead of a run")
    parser.add_argument("--scenes", nargs="+", metavar="NAME", help="record: only these")
    options = parser.parse_args(arguments)
    if options.action == "record":
        save(options.file, recorded(options.scenes))
        return 0
    scenes = list(load(options.file)[0]["with NSH"])
    return 0 if compare(options.file, stored(options.other) if options.other else recorded(scenes)) else 1


if __name__ == "__main__":
    sys.exit(main())
