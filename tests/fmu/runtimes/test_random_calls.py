"""Random calls of both versions of FMI and of all kinds of instances, with arguments of any sort, in a process that
AddressSanitizer and UndefinedBehaviorSanitizer watch.

Nothing crashes, no function says anything but OK, Warning, Discard and Error, and an instance that has been reset makes the
run of a fresh one, to the last bit.  More calls, each kind in turn, of three_bar_nsh or of another one of MODELS:
``python -m tests.fmu.runtimes.test_random_calls all 100000 laboratory``.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import sys
import tempfile
import zipfile
from ctypes import byref, c_bool, c_char, c_double, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path

import numpy as np
import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from tests.conftest import once
from tests.fmu.runtimes.test_native_host import watched_build
from tests.fmu.runtimes.test_sanitizers import preloaded, watched
from tests.support import element_scenes, fmi3_calls, native_calls, scene
from tests.support.driven_scenes import LABORATORY, MAST, built
from tests.support.fmi3_calls import TYPES, Calls3
from tests.support.native_calls import CO_SIMULATION, DISCARD, ERROR, MODEL_EXCHANGE, OK, WARNING, Calls
from tests.support.words import words

CALLS = 500
BETWEEN = 125  # calls between two comparisons with a fresh instance
WILD = [0.0, -0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1e308, math.nan, math.inf, -math.inf]
ROOT = Path(__file__).resolve().parents[3]

#: Name -> model: of the test, and others: gaps among the references, moved nodes, a vector of gravity, memory, the plane.
MODELS = {
    "three_bar_nsh": lambda: scene("three_bar_nsh"),
    "laboratory": lambda: built(LABORATORY),
    "mast": lambda: built(MAST),
    "memory": lambda: element_scenes.mast("memory"),
    "six_bar": lambda: scene("six_bar"),
}
#: Version of the standard, and how an instance is made.
KINDS = {
    "fmi2-cs": (2, {"kind": CO_SIMULATION}),
    "fmi2-me": (2, {"kind": MODEL_EXCHANGE}),
    "fmi3-cs": (3, {}),
    "fmi3-cs-events": (3, {"event_mode": True, "early_return": True}),
    "fmi3-me": (3, {"kind": "ModelExchange"}),
}


class Walk:
    """Random calls of one instance."""

    def __init__(self, folder: Path, name: str, seed: int):
        self.random = np.random.default_rng(seed)
        self.version, options = KINDS[name]
        self.exchange = options.get("kind") in (MODEL_EXCHANGE, "ModelExchange")
        if name == "fmi3-cs-events":
            options = {**options, "look": self.look}
        make = Calls if self.version == 2 else Calls3
        self.make = lambda **more: make(folder, **{**options, **more})
        self.one = self.make(logger=False)
        self.found, self.saved, self.time, self.failures = [0] * 6, [], 0.0, []
        variables = self.one.description.modelVariables
        self.settable = [v.valueReference for v in variables if v.causality in ("input", "parameter")]
        self.known = [v.valueReference for v in variables]
        self.spans = {v.valueReference: self.size(v) for v in variables}
        self.states = sum(self.size(unknown.variable) for unknown in self.one.description.derivatives)
        described = self.one.description
        if self.version == 2:
            self.indicators = int(described.numberOfEventIndicators)
            self.force = next(v.name for v in variables if v.name.endswith(".force.z") and v.causality == "input")
        else:
            self.indicators = sum(self.size(unknown.variable) for unknown in described.eventIndicators)
            self.force = next(v.name for v in variables if v.name.endswith(".force") and v.causality == "input")
        functions = (
            [*native_calls.ARGUMENTS, *native_calls.EXCHANGE_ARGUMENTS] if self.version == 2 else [*fmi3_calls.ARGUMENTS]
        )
        usual = ["DoStep", "EnterEventMode", "SetTime", "SetContinuousStates"] * 6 + ["SaveAndRestore"] * 4
        self.functions = functions + usual + [f for f in functions if f.startswith(("Get", "Set"))]

    def size(self, variable) -> int:
        dimensions = getattr(variable, "dimensions", None)
        return int(np.prod([int(one.start) for one in dimensions])) if dimensions else 1

    # Arguments

    def chance(self, p: float) -> bool:
        return self.random.random() < p

    def number(self) -> float:
        return float(self.random.choice(WILD)) if self.chance(0.15) else float(self.random.normal(scale=30.0))

    def references(self) -> tuple:
        """An array of references, or a null pointer, and how many."""
        pool = self.settable if self.chance(0.5) else self.known
        found = [int(vr) for vr in self.random.choice(pool, size=self.random.integers(0, 6))]
        if self.chance(0.2):
            found += [int(self.random.choice([max(self.known) + 1, 2**31, 2**32 - 1, self.random.integers(0, 400)]))]
        self.values = sum(self.spans.get(vr, 1) for vr in found)
        return None if self.chance(0.02) else (c_uint32 * max(len(found), 1))(*found), len(found)

    def doubles(self, count: int):
        return None if self.chance(0.02) else (c_double * max(count, 1))(*(self.number() for _ in range(count)))

    def whole(self, c_type, count: int):
        choice = [0, 1, 1, 2, 3, 5, -1, 2**31 - 1]
        return (
            None if self.chance(0.02) else (c_type * max(count, 1))(*(int(n) for n in self.random.choice(choice, size=count)))
        )

    def flag(self):
        return None if self.chance(0.02) else byref(c_bool())

    def pointer(self, c_type):
        return None if self.chance(0.02) else byref(c_type())

    def vector(self) -> tuple:
        count = self.states if self.chance(0.9) else int(self.random.choice([0, 1, 12, self.states + 1]))
        return self.doubles(count), count

    def near_states(self) -> tuple:
        """States that an instance may well be brought to."""
        x = (c_double * self.states)()
        self.one.do("GetContinuousStates", x, self.states)
        size = float(self.random.choice([1e-6, 1e-2, 1.0, 1e200]))
        return (c_double * self.states)(*(np.array(x) + self.random.normal(scale=size, size=self.states))), self.states

    def step(self) -> tuple[float, float]:
        time = self.number() if self.chance(0.1) else self.time
        return time, float(
            self.random.choice([0.01, 0.01, 0.002, 0.03, *([0.0, -1.0, math.nan, math.inf] if self.chance(0.1) else [])])
        )

    def arguments(self, name: str) -> tuple:
        return (self.of_fmi2 if self.version == 2 else self.of_fmi3)(name)

    def common(self, name: str) -> tuple | None:
        if name == "SetTime":
            return (float(self.random.random()) if self.chance(0.9) else self.number(),)
        if name == "SetContinuousStates":
            return self.near_states() if self.chance(0.9) else self.vector()
        if name.startswith("GetContinuousState") or name in ("GetDerivatives", "GetNominalsOfContinuousStates"):
            return self.vector()
        if name == "GetEventIndicators":
            count = self.indicators if self.chance(0.9) else self.indicators + 1
            return self.doubles(count), count
        if name == "SetDebugLogging":
            texts = (ctypes.c_char_p * 3)(b"logEvents", b"", None)
            return self.chance(0.5), int(self.random.integers(0, 4)), None if self.chance(0.1) else texts
        return None

    def of_fmi2(self, name: str) -> tuple:
        common = self.common(name)
        if common is not None:
            return common
        if name == "SetupExperiment":
            return self.chance(0.5), self.number(), self.number() if self.chance(0.3) else 0.0, self.chance(0.3), self.number()
        if name in ("GetReal", "SetReal"):
            references, n = self.references()
            return references, n, self.doubles(n)
        if name.endswith(("RealInputDerivatives", "RealOutputDerivatives")):
            references, n = self.references()
            return references, n, self.whole(c_int, n), self.doubles(n)
        if name.startswith(("Get", "Set")) and name.endswith(("Integer", "Boolean", "String")):
            references, n = self.references()
            strings = (ctypes.c_char_p * max(n, 1))()
            return references, n, strings if name.endswith("String") else self.whole(c_int, n)
        if name == "GetDirectionalDerivative":
            unknowns, known = self.references(), self.references()
            return *unknowns, *known, self.doubles(known[1]), self.doubles(unknowns[1])
        if name == "DoStep":
            return *self.step(), 1
        if name.endswith("Status"):
            c_type = {"GetRealStatus": c_double, "GetStringStatus": ctypes.c_char_p}.get(name, c_int)
            return int(self.random.integers(-1, 5)), self.pointer(c_type)
        if name == "CompletedIntegratorStep":
            return 1, self.pointer(c_int), self.pointer(c_int)
        if name == "NewDiscreteStates":
            return (None if self.chance(0.02) else byref((c_double * 8)()),)
        return ()

    def of_fmi3(self, name: str) -> tuple:
        common = self.common(name)
        if common is not None:
            return common
        if name == "EnterInitializationMode":
            start = self.number() if self.chance(0.3) else 0.0
            return self.chance(0.5), self.number(), start, self.chance(0.3), self.number()
        if name[:3] in ("Get", "Set") and name[3:] in (*TYPES, "Binary", "Clock"):
            return self.values_of_fmi3(name[3:])
        if name in ("GetDirectionalDerivative", "GetAdjointDerivative"):
            unknowns, several = self.references(), self.values
            known, others = self.references(), self.values
            seed, answer = (several, others) if "Adjoint" in name else (others, several)
            return *unknowns, *known, self.doubles(seed), seed, self.doubles(answer), answer
        if name == "GetOutputDerivatives":
            references, n = self.references()
            return references, n, self.whole(c_int32, n), self.doubles(self.values), self.values
        if "Interval" in name or "Shift" in name:
            rest = len(fmi3_calls.ARGUMENTS[name]) - 2
            return *self.references(), *[None] * rest
        given = {
            "DoStep": lambda: (*self.step(), True, self.flag(), self.flag(), self.flag(), self.pointer(c_double)),
            "CompletedIntegratorStep": lambda: (True, self.flag(), self.flag()),
            "UpdateDiscreteStates": lambda: (*(self.flag() for _ in range(5)), self.pointer(c_double)),
            "GetNumberOfEventIndicators": lambda: (self.pointer(c_size_t),),
            "GetNumberOfContinuousStates": lambda: (self.pointer(c_size_t),),
            "GetNumberOfVariableDependencies": lambda: (0, self.pointer(c_size_t)),
            "GetVariableDependencies": lambda: (0, None, None, None, None, 0),
            "ActivateModelPartition": lambda: (0, self.number()),
        }.get(name)
        return given() if given else ()

    def values_of_fmi3(self, kind: str) -> tuple:
        references, n = self.references()
        count = self.values if self.chance(0.9) else int(self.random.integers(0, 9))
        if kind == "Float64":
            return references, n, self.doubles(count), count
        if kind in ("Int32", "Int64"):
            return references, n, self.whole(c_int32 if kind == "Int32" else c_int64, count), count
        room = (c_int64 * max(count, 1))()
        if kind == "Binary":
            return references, n, None, room, count
        return (references, n, None) if kind == "Clock" else (references, n, room, count)

    # Calls

    def look(self, time: float, may_end: bool) -> bool:
        """While a step is under way: mostly what may be called then."""
        if self.chance(0.3):
            name = (
                self.random.choice(["GetFloat64", "GetOutputDerivatives"] * 20 + self.functions)
                if self.chance(0.5)
                else "GetFloat64"
            )
            try:
                self.call(name)
            except AssertionError as error:
                self.failures.append(error)  # an exception cannot pass the FMU
        return self.chance(0.2)

    def call(self, name: str) -> int:
        if name == "SaveAndRestore" or "FMU" in name:
            return self.states_saved()
        given = self.arguments(name)
        status = self.one.do(name, *given)
        assert status in (OK, WARNING, DISCARD, ERROR), (name, status)
        if (name == "DoStep" and status == OK) or name in ("SetTime", "Reset", "SetupExperiment", "EnterInitializationMode"):
            self.clock()
        self.found[status] += 1
        return status

    def clock(self) -> None:
        """Where the instance stands, as far as it tells."""
        value = c_double()
        if self.version == 2:
            if self.one.do("GetRealStatus", native_calls.LAST_SUCCESSFUL_TIME, byref(value)) == OK:
                self.time = value.value
            else:
                self.time = 0.0
        elif self.one.do("GetFloat64", self.one.references(["time"]), 1, byref(value), 1) == OK:
            self.time = value.value

    def states_saved(self) -> int:
        one, small = self.one, self.version == 2
        names = [f"{verb}FMU{'state' if small else 'State'}" for verb in ("Get", "Set", "Free")]
        state, size = c_void_p(), c_size_t()
        status = one.do(names[0], None if self.chance(0.02) else byref(state))
        if status == OK and state.value:
            assert one.do("SerializedFMUstateSize" if small else "SerializedFMUStateSize", state, byref(size)) == OK
            data = (c_char * size.value)()
            short = int(self.random.integers(0, size.value)) if self.chance(0.1) else size.value
            room = (c_char * max(short, 1))() if short < size.value else data
            wrote = one.do("SerializeFMUstate" if small else "SerializeFMUState", state, room, short)
            assert wrote == (OK if short == size.value else DISCARD)
            if wrote == OK:
                self.saved = [*self.saved[-10:], data.raw]
            assert one.do(names[2], byref(state)) == OK
        if self.saved and self.chance(0.6):
            data = self.saved[int(self.random.integers(len(self.saved)))]
            if self.chance(0.3):
                data = self.damaged(data)
            given = (None if self.chance(0.02) else data), len(data)
            status = one.do("DeSerializeFMUstate" if small else "DeserializeFMUState", *given, byref(state))
            if status == OK:
                status = one.do(names[1], state)
                one.do(names[2], byref(state))
                self.clock()
        self.found[status] += 1
        return status

    def damaged(self, data: bytes) -> bytes:
        cut, at = int(self.random.integers(0, len(data))), int(self.random.integers(0, len(data)))
        if self.chance(0.5):
            return data[:cut]
        return data[:at] + bytes([data[at] ^ int(self.random.integers(1, 256))]) + data[at + 1 :]

    def bring_somewhere(self) -> None:
        modes = ["instantiated", "initialization", "terminated", "error"]
        modes += (["event", "continuous"] if self.exchange else ["stepping"]) * 3
        self.one.do("Reset")
        mode = str(self.random.choice(modes))
        if self.version == 2 and self.exchange and mode in ("event", "continuous"):
            self.one.start()
            if mode == "continuous":
                self.one.do("EnterContinuousTimeMode")
        else:
            self.one.bring_to(mode)
        self.clock()

    def walk(self, count: int) -> None:
        fresh = self.make(look=None) if self.version == 3 and not self.exchange else self.make()
        expected = self.run(fresh)
        fresh.free()
        status = OK
        for n in range(count):
            if n % 15 == 0 or (status == ERROR and self.chance(0.5)):
                self.bring_somewhere()
            status = self.call(str(self.random.choice(self.functions)))
            assert not self.failures
            if n % BETWEEN == BETWEEN - 1:
                assert np.array_equal(self.run(self.one), expected)
        self.one.free()

    def run(self, one) -> np.ndarray:
        """A run from a reset on."""
        look, rows = getattr(one, "look", None), []
        one.look = None if look is None else lambda time, may_end: False
        assert one.do("Reset") == OK and one.start() == OK
        if self.exchange:
            assert one.do("EnterContinuousTimeMode") == OK
            x = (c_double * self.states)()
            assert one.do("GetContinuousStates", x, self.states) == OK
            name = "GetDerivatives" if self.version == 2 else "GetContinuousStateDerivatives"
            assert one.do(name, x, self.states) == OK
            rows = [np.array(x), one.outputs()]
        else:
            push = 50.0 if self.version == 2 else [0.0] * (one.size(self.force) - 1) + [50.0]
            assert one.set({self.force: push}) == OK
            if self.version == 3 and one.event_mode:
                assert one.update()[0] == OK and one.do("EnterStepMode") == OK
            time = 0.0
            while time < 0.03 - 1e-9:
                h = min(0.01, 0.03 - time)
                assert one.step(time, h) == OK
                time = one.reached if self.version == 3 else time + h
                rows.append(one.outputs())
        one.look = look
        return np.concatenate(rows)


def folders(base: Path, name: str = "three_bar_nsh") -> dict[int, Path]:
    """Extracted FMUs of both kinds of a model, by version of the standard."""
    found = {2: base / "fmi2", 3: base / "fmi3"}
    for version, folder in found.items():
        fmu = pack_native_fmu(MODELS[name](), base / f"{version}.fmu", kind="both", standard=f"{version}.0")
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
    return found


def walked(base: Path, names: list[str], calls: int, seed: int, library: Path | None) -> dict[str, list[int]]:
    """How often each status came, from one process for all, so that a crash is a failure and not the end of this one."""
    scratch = base
    if library is not None:
        scratch = base.with_name(f"{base.name}_watched")
        for version, calls_of in ((2, native_calls), (3, fmi3_calls)):
            folder = shutil.copytree(base / f"fmi{version}", scratch / f"fmi{version}", dirs_exist_ok=True)
            shutil.copy(library, calls_of.library_of(folder))
    command = [
        sys.executable,
        "-m",
        "tests.fmu.runtimes.test_random_calls",
        ",".join(names),
        str(calls),
        str(scratch),
        str(seed),
    ]
    environment = watched() if library is not None else None
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300 + calls, env=environment)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-6000:]
    lines = [line.split() for line in done.stdout.splitlines()]
    return {name: [int(word) for word in words] for name, *words in lines}


@pytest.fixture(scope="session")
def base(tmp_path_factory) -> Path:
    return once(tmp_path_factory, "random_calls", folders)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's loader puts the sanitizers into the process")
def test_random_calls_are_clean_under_sanitizers(base, tmp_path_factory):
    library = watched_build(tmp_path_factory) / "native.so"
    if not preloaded():
        pytest.skip("the sanitizers are not there as libraries")
    told = walked(base, list(KINDS), CALLS, 1, library)
    assert list(told) == list(KINDS)
    for name, found in told.items():
        assert min(found[OK], found[DISCARD], found[ERROR]) > CALLS / 20, name


class Folders:
    """As pytest's factory of folders has it."""

    def __init__(self, base):
        self.base = base

    def getbasetemp(self):
        return self.base


def main(calls: int, model: str = "three_bar_nsh", seeds: int = 1) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        library = watched_build(Folders(Path(scratch))) / "native.so"
        base = Path(scratch) / "fmus"
        folders(base, model)
        for name in KINDS:
            for seed in range(seeds):
                found = walked(base, [name], calls, seed, library)[name]
                told = ", ".join(f"{found[status]} {word}" for status, word in enumerate(("OK", "Warning", "Discard", "Error")))
                print(f"{model}, {name}, seed {seed}: {told}", flush=True)


if __name__ == "__main__":
    kinds, calls, model_or_folder, seed = words(__doc__, str, int, model="three_bar_nsh", seeds=1)
    if kinds == "all":
        main(calls, model_or_folder, seed)
    else:  # in a process of its own, see walked()
        for kind in kinds.split(","):
            walk = Walk(Path(model_or_folder).resolve() / f"fmi{KINDS[kind][0]}", kind, seed)
            walk.walk(calls)
            print(kind, *walk.found, flush=True)
