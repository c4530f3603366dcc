"""The native FMU through its C interface as it is: every call returns its status, null pointers can be passed.

fmpy's wrapper turns a status into an exception and has no way to pass what a broken host would pass.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_char, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from functools import cache
from pathlib import Path

import numpy as np

OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
CO_SIMULATION, MODEL_EXCHANGE = 1, 0
DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED = range(4)
MODES = ("instantiated", "initialization", "stepping", "terminated", "error")

LOGGER = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)


class Callbacks(ctypes.Structure):
    _fields_ = [
        ("logger", LOGGER),
        ("allocate", c_void_p),
        ("free", c_void_p),
        ("step_finished", c_void_p),
        ("environment", c_void_p),
    ]


_REFERENCES, _ORDERS, _REALS = POINTER(c_uint), POINTER(c_int), POINTER(c_double)

#: Arguments of each function after the component.
ARGUMENTS = {
    "SetDebugLogging": (c_int, c_size_t, POINTER(c_char_p)),
    "SetupExperiment": (c_int, c_double, c_double, c_int, c_double),
    "EnterInitializationMode": (),
    "ExitInitializationMode": (),
    "Terminate": (),
    "Reset": (),
    "GetReal": (_REFERENCES, c_size_t, _REALS),
    "GetInteger": (_REFERENCES, c_size_t, _ORDERS),
    "GetBoolean": (_REFERENCES, c_size_t, _ORDERS),
    "GetString": (_REFERENCES, c_size_t, POINTER(c_char_p)),
    "SetReal": (_REFERENCES, c_size_t, _REALS),
    "SetInteger": (_REFERENCES, c_size_t, _ORDERS),
    "SetBoolean": (_REFERENCES, c_size_t, _ORDERS),
    "SetString": (_REFERENCES, c_size_t, POINTER(c_char_p)),
    "GetFMUstate": (POINTER(c_void_p),),
    "SetFMUstate": (c_void_p,),
    "FreeFMUstate": (POINTER(c_void_p),),
    "SerializedFMUstateSize": (c_void_p, POINTER(c_size_t)),
    "SerializeFMUstate": (c_void_p, POINTER(c_char), c_size_t),
    "DeSerializeFMUstate": (c_char_p, c_size_t, POINTER(c_void_p)),
    "GetDirectionalDerivative": (_REFERENCES, c_size_t, _REFERENCES, c_size_t, _REALS, _REALS),
    "SetRealInputDerivatives": (_REFERENCES, c_size_t, _ORDERS, _REALS),
    "GetRealOutputDerivatives": (_REFERENCES, c_size_t, _ORDERS, _REALS),
    "DoStep": (c_double, c_double, c_int),
    "CancelStep": (),
    "GetStatus": (c_int, POINTER(c_int)),
    "GetRealStatus": (c_int, _REALS),
    "GetIntegerStatus": (c_int, POINTER(c_int)),
    "GetBooleanStatus": (c_int, POINTER(c_int)),
    "GetStringStatus": (c_int, POINTER(c_char_p)),
}

#: The same of model exchange, which the native library alone has.
EXCHANGE_ARGUMENTS = {
    "EnterEventMode": (),
    "NewDiscreteStates": (c_void_p,),
    "EnterContinuousTimeMode": (),
    "CompletedIntegratorStep": (c_int, POINTER(c_int), POINTER(c_int)),
    "SetTime": (c_double,),
    "SetContinuousStates": (_REALS, c_size_t),
    "GetContinuousStates": (_REALS, c_size_t),
    "GetDerivatives": (_REALS, c_size_t),
    "GetNominalsOfContinuousStates": (_REALS, c_size_t),
    "GetEventIndicators": (_REALS, c_size_t),
}


def load(path: Path, mode: int = ctypes.DEFAULT_MODE) -> ctypes.CDLL:
    """The library of a native FMU with the prototypes of FMI 2.0."""
    library = ctypes.CDLL(str(path), mode=mode)
    library.fmi2GetTypesPlatform.restype = library.fmi2GetVersion.restype = c_char_p
    library.fmi2Instantiate.restype = c_void_p
    library.fmi2Instantiate.argtypes = (c_char_p, c_int, c_char_p, c_char_p, POINTER(Callbacks), c_int, c_int)
    library.fmi2FreeInstance.restype, library.fmi2FreeInstance.argtypes = None, (c_void_p,)
    for name, arguments in ARGUMENTS.items():
        getattr(library, f"fmi2{name}").argtypes = (c_void_p, *arguments)
    for name, arguments in EXCHANGE_ARGUMENTS.items():
        if hasattr(library, f"fmi2{name}"):
            getattr(library, f"fmi2{name}").argtypes = (c_void_p, *arguments)
    return library


@cache
def described(folder: Path):
    """fmpy's description of an extracted FMU."""
    from fmpy import read_model_description

    return read_model_description(str(folder))


def library_of(folder: Path) -> Path:
    """The library for this platform in an extracted FMU."""
    from fmu_src.packing.libraries import here

    return next((folder / "binaries" / here()).iterdir())


class Calls:
    """One instance of the FMU in a folder; `do` and most other methods return the status.

    messages: (status, category, text) as the FMU logged them; component: None where fmi2Instantiate failed.
    """

    def __init__(self, folder, name=b"one", kind=CO_SIMULATION, guid=None, location=None, logging=True, logger=True):
        self.folder = Path(folder)
        self.description = described(self.folder)
        self.by_name = {variable.name: variable for variable in self.description.modelVariables}
        self.library = load(library_of(self.folder))
        self.messages: list[tuple[int, str, str]] = []
        self._logger = LOGGER(self._log)
        self._callbacks = Callbacks(logger=self._logger)
        guid = self.description.guid.encode() if guid is None else guid
        location = (self.folder / "resources").as_uri().encode() if location is None else location
        callbacks = byref(self._callbacks) if logger else None
        self.component = self.library.fmi2Instantiate(name, kind, guid or None, location or None, callbacks, 0, logging)

    def _log(self, environment, name, status, category, message):
        self.messages.append((status, category.decode(), message.decode()))

    def free(self):
        if self.component:
            self.library.fmi2FreeInstance(self.component)
        self.component = None

    def do(self, function: str, *arguments) -> int:
        """Call fmi2<function> with further C arguments; None is a null pointer."""
        return getattr(self.library, f"fmi2{function}")(self.component, *arguments)

    def said(self, *words) -> bool:
        """Whether one message holds all these words."""
        return any(all(word in text for word in words) for _, _, text in self.messages)

    # Life cycle

    def start(self, parameters=None, start_time=0.0, stop_time=None, tolerance=None) -> int:
        """Up to the first step; the worst status on the way."""
        stop, tol = (0.0 if value is None else value for value in (stop_time, tolerance))
        found = [self.do("SetupExperiment", tolerance is not None, tol, start_time, stop_time is not None, stop)]
        found.append(self.set(parameters or {}))
        found += [self.do("EnterInitializationMode"), self.do("ExitInitializationMode")]
        return max(found)

    def bring_to(self, mode: str) -> None:
        """From a fresh instance to one of MODES."""
        if mode == "initialization":
            self.do("SetupExperiment", 0, 0.0, 0.0, 0, 0.0)
            self.do("EnterInitializationMode")
        elif mode != "instantiated":
            self.start()
        if mode == "terminated":
            self.do("Terminate")
        elif mode == "error":
            self.do("EnterInitializationMode")
        self.messages.clear()

    def step(self, time: float, h: float) -> int:
        return self.do("DoStep", time, h, 1)

    def walk(self, steps: int, h: float = 0.01, start: int = 0) -> np.ndarray:
        """(steps, outputs) after each of some steps that must succeed."""
        rows = []
        for k in range(start, start + steps):
            assert self.step(k * h, h) == OK, self.messages
            rows.append(self.outputs())
        return np.array(rows)

    # Values

    def references(self, names):
        return (c_uint * max(len(names), 1))(*(self.by_name[name].valueReference for name in names))

    def names(self, causality: str, kind: str = "Real") -> list[str]:
        variables = self.description.modelVariables
        return [v.name for v in variables if v.causality == causality and (v.type == "Real") == (kind == "Real")]

    def set(self, values: dict) -> int:
        """Reals in one call, integers in another; the worst status."""
        reals = [name for name in values if self.by_name[name].type == "Real"]
        whole = [name for name in values if name not in reals]
        found = OK
        if reals:
            found = self.do("SetReal", self.references(reals), len(reals), (c_double * len(reals))(*(values[n] for n in reals)))
        if whole:
            given = (c_int * len(whole))(*(values[name] for name in whole))
            found = max(found, self.do("SetInteger", self.references(whole), len(whole), given))
        return found

    def get(self, *names):
        """Values of real variables; one value where one is asked for.  The call must succeed."""
        values = (c_double * len(names))()
        assert self.do("GetReal", self.references(names), len(names), values) == OK, self.messages
        return values[0] if len(names) == 1 else list(values)

    def integer(self, name: str) -> int:
        value = c_int()
        assert self.do("GetInteger", self.references([name]), 1, byref(value)) == OK, self.messages
        return value.value

    def outputs(self) -> np.ndarray:
        """All outputs, the integers behind the reals."""
        integers = [self.integer(name) for name in self.names("output", "Integer")]
        return np.array([*self.get(*self.names("output")), *integers])

    def slopes(self, values: dict, order: int = 1) -> int:
        """Set derivatives of inputs."""
        given = (c_double * len(values))(*values.values())
        return self.do(
            "SetRealInputDerivatives",
            self.references(list(values)),
            len(values),
            (c_int * len(values))(*[order] * len(values)),
            given,
        )

    def output_derivatives(self, names) -> tuple[int, np.ndarray]:
        found, ones = (c_double * len(names))(), (c_int * len(names))(*[1] * len(names))
        status = self.do("GetRealOutputDerivatives", self.references(names), len(names), ones, found)
        return status, np.array(found)

    def last_time(self) -> float:
        """fmi2LastSuccessfulTime, s."""
        value = c_double()
        assert self.do("GetRealStatus", LAST_SUCCESSFUL_TIME, byref(value)) == OK
        return value.value

    # States

    def save(self) -> c_void_p:
        state = c_void_p()
        assert self.do("GetFMUstate", byref(state)) == OK
        return state

    def drop(self, state: c_void_p) -> None:
        assert self.do("FreeFMUstate", byref(state)) == OK and not state.value

    def serialised(self) -> bytes:
        """The present state as bytes."""
        state, size = self.save(), c_size_t()
        assert self.do("SerializedFMUstateSize", state, byref(size)) == OK
        data = ctypes.create_string_buffer(size.value)
        assert self.do("SerializeFMUstate", state, data, size) == OK
        self.drop(state)
        return data.raw

    def restore(self, data: bytes) -> int:
        """Go to a serialised state; the status of the first call that refuses."""
        state = c_void_p()
        found = self.do("DeSerializeFMUstate", data, len(data), byref(state))
        if found == OK:
            found = self.do("SetFMUstate", state)
            self.drop(state)
        return found
