"""The native FMU of FMI 3.0 through its C interface as it is, as native_calls.py has FMI 2.0's."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import POINTER, byref, c_bool, c_char, c_char_p, c_double, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path

import numpy as np

from fmu_src.packing.libraries import here, tuples
from tests.support.native_calls import OK, described

LOG = ctypes.CFUNCTYPE(None, c_void_p, ctypes.c_int, c_char_p, c_char_p)
INTERMEDIATE = ctypes.CFUNCTYPE(None, c_void_p, c_double, c_bool, c_bool, c_bool, c_bool, POINTER(c_bool), POINTER(c_double))

_REFERENCES, _REALS, _FLAG = POINTER(c_uint32), POINTER(c_double), POINTER(c_bool)
_LIST = (_REFERENCES, c_size_t)
_VALUES = (*_LIST, c_void_p, c_size_t)
_STATES = (_REALS, c_size_t)
_PRODUCT = (*_LIST, *_LIST, _REALS, c_size_t, _REALS, c_size_t)

#: Types of which FMI 3.0 has variables.
TYPES = ("Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String")

#: Arguments of each function after the instance.
ARGUMENTS = {
    "SetDebugLogging": (c_bool, c_size_t, POINTER(c_char_p)),
    "EnterInitializationMode": (c_bool, c_double, c_double, c_bool, c_double),
    "ExitInitializationMode": (),
    "EnterEventMode": (),
    "Terminate": (),
    "Reset": (),
    **{f"{verb}{kind}": _VALUES for verb in ("Get", "Set") for kind in TYPES},
    "GetBinary": (*_LIST, POINTER(c_size_t), c_void_p, c_size_t),
    "SetBinary": (*_LIST, POINTER(c_size_t), c_void_p, c_size_t),
    "GetClock": (*_LIST, _FLAG),
    "SetClock": (*_LIST, _FLAG),
    "GetNumberOfVariableDependencies": (c_uint32, POINTER(c_size_t)),
    "GetVariableDependencies": (c_uint32, POINTER(c_size_t), _REFERENCES, POINTER(c_size_t), c_void_p, c_size_t),
    "GetFMUState": (POINTER(c_void_p),),
    "SetFMUState": (c_void_p,),
    "FreeFMUState": (POINTER(c_void_p),),
    "SerializedFMUStateSize": (c_void_p, POINTER(c_size_t)),
    "SerializeFMUState": (c_void_p, POINTER(c_char), c_size_t),
    "DeserializeFMUState": (c_char_p, c_size_t, POINTER(c_void_p)),
    "GetDirectionalDerivative": _PRODUCT,
    "GetAdjointDerivative": _PRODUCT,
    "EnterConfigurationMode": (),
    "ExitConfigurationMode": (),
    "GetIntervalDecimal": (*_LIST, _REALS, c_void_p),
    "GetIntervalFraction": (*_LIST, c_void_p, c_void_p, c_void_p),
    "GetShiftDecimal": (*_LIST, _REALS),
    "GetShiftFraction": (*_LIST, c_void_p, c_void_p),
    "SetIntervalDecimal": (*_LIST, _REALS),
    "SetIntervalFraction": (*_LIST, c_void_p, c_void_p),
    "SetShiftDecimal": (*_LIST, _REALS),
    "SetShiftFraction": (*_LIST, c_void_p, c_void_p),
    "EvaluateDiscreteStates": (),
    "UpdateDiscreteStates": (_FLAG, _FLAG, _FLAG, _FLAG, _FLAG, _REALS),
    "EnterContinuousTimeMode": (),
    "CompletedIntegratorStep": (c_bool, _FLAG, _FLAG),
    "SetTime": (c_double,),
    "SetContinuousStates": _STATES,
    "GetContinuousStateDerivatives": _STATES,
    "GetEventIndicators": _STATES,
    "GetContinuousStates": _STATES,
    "GetNominalsOfContinuousStates": _STATES,
    "GetNumberOfEventIndicators": (POINTER(c_size_t),),
    "GetNumberOfContinuousStates": (POINTER(c_size_t),),
    "EnterStepMode": (),
    "GetOutputDerivatives": (*_LIST, POINTER(c_int32), _REALS, c_size_t),
    "DoStep": (c_double, c_double, c_bool, _FLAG, _FLAG, _FLAG, _REALS),
    "ActivateModelPartition": (c_uint32, c_double),
}

_BEGIN = (c_char_p, c_char_p, c_char_p, c_bool, c_bool)
INSTANTIATE = {
    "ModelExchange": (*_BEGIN, c_void_p, LOG),
    "CoSimulation": (*_BEGIN, c_bool, c_bool, _REFERENCES, c_size_t, c_void_p, LOG, INTERMEDIATE),
    "ScheduledExecution": (*_BEGIN, c_void_p, LOG, c_void_p, c_void_p, c_void_p),
}


def load(path: Path) -> ctypes.CDLL:
    """The library of a native FMU with the prototypes of FMI 3.0."""
    library = ctypes.CDLL(str(path))
    library.fmi3GetVersion.restype = c_char_p
    library.fmi3FreeInstance.restype, library.fmi3FreeInstance.argtypes = None, (c_void_p,)
    for kind, arguments in INSTANTIATE.items():
        function = getattr(library, f"fmi3Instantiate{kind}")
        function.restype, function.argtypes = c_void_p, arguments
    for name, arguments in ARGUMENTS.items():
        getattr(library, f"fmi3{name}").argtypes = (c_void_p, *arguments)
    return library


def library_of(folder: Path) -> Path:
    """The library for this platform in an extracted FMU."""
    (place,) = tuples({here(): folder})
    return next((folder / "binaries" / place).iterdir())


class Calls3:
    """One instance of the FMU in a folder; `do` and most other methods return the status.

    kind: of INSTANTIATE; look: called with (time, may end) at internal steps and transitions, its answer is the host's wish to
    return; messages: (status, category, text) as the FMU logged them; component: None where there is no instance.
    """

    def __init__(
        self,
        folder,
        kind: str = "CoSimulation",
        name: bytes | None = b"one",
        token: bytes | None = None,
        path: bytes | None = None,
        logging: bool = True,
        logger: bool = True,
        event_mode: bool = False,
        early_return: bool = False,
        look: Callable[[float, bool], bool] | None = None,
        required: tuple[int, ...] = (),
    ):
        self.folder = Path(folder)
        self.description = described(self.folder)
        self.by_name = {variable.name: variable for variable in self.description.modelVariables}
        self.library = load(library_of(self.folder))
        self.messages: list[tuple[int, str, str]] = []
        self.look, self.kind, self.event_mode = look, kind, event_mode
        self._log, self._look = LOG(self._logged if logger else 0), INTERMEDIATE(self._looked if look else 0)
        token = self.description.instantiationToken.encode() if token is None else token
        path = f"{self.folder / 'resources'}/".encode() if path is None else path
        common = [name, token or None, path or None, False, logging]
        if kind == "CoSimulation":
            references = (c_uint32 * max(len(required), 1))(*required)
            rest = [event_mode, early_return, references, len(required), None, self._log, self._look]
        else:
            rest = [None, self._log] + [None] * (3 if kind == "ScheduledExecution" else 0)
        self.component = getattr(self.library, f"fmi3Instantiate{kind}")(*common, *rest)

    def _logged(self, environment, status, category, message):
        self.messages.append((status, category.decode(), message.decode()))

    def _looked(self, environment, time, set_requested, get_allowed, finished, may_end, requested, return_time):
        assert not set_requested and get_allowed and finished
        requested[0] = bool(self.look(time, may_end))
        return_time[0] = time

    def free(self):
        if self.component:
            self.library.fmi3FreeInstance(self.component)
        self.component = None

    def do(self, function: str, *arguments) -> int:
        """Call fmi3<function> with further C arguments; None is a null pointer."""
        return getattr(self.library, f"fmi3{function}")(self.component, *arguments)

    def said(self, *words) -> bool:
        """Whether one message holds all these words."""
        return any(all(word in text for word in words) for _, _, text in self.messages)

    # Life cycle

    def start(self, values=None, start_time=0.0, stop_time=None, tolerance=None) -> int:
        """Up to the first mode after initialization; the worst status on the way."""
        stop, tol = (0.0 if value is None else value for value in (stop_time, tolerance))
        found = [self.set(values or {})]
        found.append(self.do("EnterInitializationMode", tolerance is not None, tol, start_time, stop_time is not None, stop))
        return max(*found, self.do("ExitInitializationMode"))

    def bring_to(self, mode: str) -> None:
        """From a fresh instance to instantiated, initialization, event, stepping, continuous, terminated or error."""
        if mode == "initialization":
            self.do("EnterInitializationMode", False, 0.0, 0.0, False, 0.0)
        elif mode != "instantiated":
            self.start()
        if mode == "stepping" and self.event_mode:
            self.do("EnterStepMode")
        elif mode == "continuous":
            self.do("EnterContinuousTimeMode")
        elif mode == "terminated":
            self.do("Terminate")
        elif mode == "error":
            self.do("EnterInitializationMode", False, 0.0, 0.0, False, 0.0)
        self.messages.clear()

    def step(self, time: float, h: float) -> int:
        """The status; `early` and `reached`: what the FMU said of the step."""
        event, end, early, reached = c_bool(True), c_bool(True), c_bool(), c_double()
        status = self.do("DoStep", time, h, True, byref(event), byref(end), byref(early), byref(reached))
        assert status != OK or not (event.value or end.value)
        self.early, self.reached = early.value, reached.value
        return status

    def update(self) -> tuple[int, bool]:
        """fmi3UpdateDiscreteStates: the status, and whether states changed."""
        flags, next_event = [c_bool(True) for _ in range(5)], c_double()
        status = self.do("UpdateDiscreteStates", *map(byref, flags), byref(next_event))
        if status == OK:
            assert not any(flag.value for flag in (*flags[:3], flags[4]))
        return status, flags[3].value

    # Values

    def references(self, names):
        return (c_uint32 * max(len(names), 1))(*(self.by_name[name].valueReference for name in names))

    def size(self, name: str) -> int:
        """How many values a variable has."""
        dimensions = self.by_name[name].dimensions
        return int(np.prod([int(one.start) for one in dimensions])) if dimensions else 1

    def names(self, causality: str, kind: str = "Float64") -> list[str]:
        return [v.name for v in self.description.modelVariables if v.causality == causality and v.type == kind]

    def set(self, values: dict) -> int:
        """Float64 in one call, integers and enumerations each in one; the worst status."""
        found = OK
        for kind, function, c_type in (("Float64", "SetFloat64", c_double), ("Enumeration", "SetInt64", c_int64)):
            names = [name for name in values if self.by_name[name].type == kind]
            given = np.concatenate([np.ravel(values[name]) for name in names]) if names else np.zeros(0)
            if names:
                data = (c_type * len(given))(*(given.tolist() if c_type is c_double else map(int, given)))
                found = max(found, self.do(function, self.references(names), len(names), data, len(given)))
        return found

    def get(self, *names) -> np.ndarray:
        """(values,) of Float64 variables, arrays one after the other.  The call must succeed."""
        count = sum(map(self.size, names))
        values = (c_double * max(count, 1))()
        assert self.do("GetFloat64", self.references(names), len(names), values, count) == OK, self.messages
        return np.array(values[:count])

    def integer(self, name: str, function: str = "GetInt32") -> int:
        value = (c_int32 if function.endswith("32") else c_int64)()
        assert self.do(function, self.references([name]), 1, byref(value), 1) == OK, self.messages
        return value.value

    def outputs(self) -> np.ndarray:
        """All outputs, the integers behind the reals."""
        integers = [self.integer(name) for name in self.names("output", "Int32")]
        return np.array([*self.get(*self.names("output")), *integers])

    def output_derivatives(self, *names) -> tuple[int, np.ndarray]:
        count, ones = sum(map(self.size, names)), (c_int32 * len(names))(*[1] * len(names))
        found = (c_double * count)()
        status = self.do("GetOutputDerivatives", self.references(names), len(names), ones, found, count)
        return status, np.array(found)

    # States

    @property
    def states_count(self) -> int:
        count = c_size_t()
        assert self.do("GetNumberOfContinuousStates", byref(count)) == OK
        return count.value

    def vector(self, function: str, count: int) -> tuple[int, np.ndarray]:
        found = (c_double * count)()
        return self.do(function, found, count), np.array(found)

    def put(self, x) -> int:
        return self.do("SetContinuousStates", (c_double * len(x))(*x), len(x))

    def serialised(self) -> bytes:
        """The present state as bytes."""
        state, size = c_void_p(), c_size_t()
        assert self.do("GetFMUState", byref(state)) == OK
        assert self.do("SerializedFMUStateSize", state, byref(size)) == OK
        data = ctypes.create_string_buffer(size.value)
        assert self.do("SerializeFMUState", state, data, size) == OK
        assert self.do("FreeFMUState", byref(state)) == OK and not state.value
        return data.raw

    def restore(self, data: bytes) -> int:
        """Go to a serialised state; the status of the first call that refuses."""
        state = c_void_p()
        found = self.do("DeserializeFMUState", data, len(data), byref(state))
        if found == OK:
            found = self.do("SetFMUState", state)
            assert self.do("FreeFMUState", byref(state)) == OK
        return found
