"""The C kernel from Python: one `Kernel` is one simulation.

The binding needs NumPy and the compiled library only, so that it can be packed into an FMU.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, SimulationError, TensegrityError
from ..fields import COUNTS, FIELDS, INTEGER_FIELDS, STATS, layout
from ..model import Model, Transition
from ..quantities import array_of, number
from .packing import to_bytes

LIBRARY = {"win32": "tensegrity.dll", "darwin": "libtensegrity.dylib"}.get(sys.platform, "libtensegrity.so")
BESIDE = Path(__file__).resolve().parent.parent / "native"


class _Transition(ctypes.Structure):
    _fields_ = [("time", c_double), ("loss", c_double)]
    _fields_ += [("string", c_int32), ("before", c_int32), ("after", c_int32), ("contact", c_int32)]


class _Piece(ctypes.Structure):
    _fields_ = [("lo", c_double), ("hi", c_double), ("loss_up", c_double), ("loss_down", c_double)]
    _fields_ += [("up", c_int32), ("down", c_int32), ("snapped", c_int32), ("slack", c_int32)]


class Piece(NamedTuple):
    """A piece of a string's force curve.

    lo, hi: its ends, m; up, down: places of the pieces beyond hi and lo, -1: none; loss_up, loss_down: what a snap there
    dissipates, J; snapped: beams past their force maximum; slack: the string bears nothing.
    """

    lo: float
    hi: float
    up: int
    down: int
    loss_up: float
    loss_down: float
    snapped: int
    slack: bool


#: What the C library calls where a watched step has come to: context, simulation, moment -> an answer.
_WATCHER = ctypes.CFUNCTYPE(c_int, c_void_p, c_void_p, c_int)
_AT_TRANSITION = 2
_GO_ON, _END_HERE, _GIVE_UP = range(3)

#: Outputs that are computed together: positions and velocities of nodes and motors, and snapped beams; forces and lengths of
#: strings, bar forces and reactions; energies; what the ledger integrates.
GROUPS = ("motion", "forces", "energies", "work")

_PROTOTYPES = {
    "ts_create": (c_void_p, c_char_p, c_size_t, c_char_p, c_size_t),
    "ts_free": (None, c_void_p),
    "ts_counts": (None, c_void_p, POINTER(c_int32)),
    "ts_values": (POINTER(c_double), c_void_p),
    "ts_integers": (POINTER(c_int32), c_void_p),
    "ts_slopes": (POINTER(c_double), c_void_p),
    "ts_input_count": (c_int32, c_void_p),
    "ts_output_derivatives": (c_int, c_void_p, POINTER(c_double)),
    "ts_time": (c_double, c_void_p),
    "ts_message": (c_char_p, c_void_p),
    "ts_concerned": (c_int32, c_void_p),
    "ts_status_name": (c_char_p, c_int),
    "ts_check": (c_int, c_void_p, POINTER(c_int32)),
    "ts_initialize": (c_int, c_void_p, c_double),
    "ts_reset": (c_int, c_void_p),
    "ts_step": (c_int, c_void_p, c_double),
    "ts_step_watched": (c_int, c_void_p, c_double, _WATCHER, c_void_p, POINTER(c_double)),
    "ts_want": (None, c_void_p, c_int),
    "ts_fill": (c_int, c_void_p, c_int),
    "ts_fill_at": (c_int, c_void_p, POINTER(c_uint32), c_size_t),
    "ts_look": (c_int, c_void_p),
    "ts_take_inputs": (c_int, c_void_p),
    "ts_transition_count": (c_int64, c_void_p),
    "ts_transition_stored": (c_int32, c_void_p),
    "ts_transitions": (POINTER(_Transition), c_void_p),
    "ts_snapped": (c_int32, c_void_p, c_int32, c_int32),
    "ts_stats": (None, c_void_p, POINTER(c_int64)),
    "ts_state_size": (c_size_t, c_void_p),
    "ts_save": (c_int, c_void_p, c_char_p, c_size_t),
    "ts_restore": (c_int, c_void_p, c_char_p, c_size_t),
    "ts_continuous_count": (c_int32, c_void_p),
    "ts_indicator_count": (c_int32, c_void_p),
    "ts_continuous_nominals": (None, c_void_p, POINTER(c_double)),
    "ts_continuous_states": (c_int, c_void_p, POINTER(c_double)),
    "ts_set_continuous_states": (c_int, c_void_p, POINTER(c_double)),
    "ts_set_time": (c_int, c_void_p, c_double),
    "ts_continuous_derivatives": (c_int, c_void_p, POINTER(c_double)),
    "ts_continuous_outputs": (c_int, c_void_p),
    "ts_event_indicators": (c_int, c_void_p, POINTER(c_double)),
    "ts_completed_step": (c_int, c_void_p),
    "ts_enter_event": (c_int, c_void_p),
    "ts_update_discrete": (c_int, c_void_p, POINTER(c_int32)),
    "ts_known_count": (c_int32, c_void_p),
    "ts_unknown_count": (c_int32, c_void_p),
    "ts_derivatives_size": (c_size_t, c_void_p),
    "ts_differentiable": (c_int, c_void_p, c_int32),
    "ts_differentiated": (c_int, c_void_p, c_int32),
    "ts_share_derivatives": (c_int, c_void_p, c_void_p, c_size_t),
    "ts_differentiate": (c_int, c_void_p, c_int, c_void_p),
    "ts_directional": (c_int, c_void_p, c_void_p, POINTER(c_double), POINTER(c_double)),
    "ts_adjoint": (c_int, c_void_p, c_void_p, POINTER(c_double), POINTER(c_double)),
    "ts_memory_size": (c_size_t, c_void_p),
    "ts_locate": (None, c_void_p, c_int),
    "ts_state_length": (c_int32, c_void_p),
    "ts_get_state": (None, c_void_p, POINTER(c_double)),
    "ts_derivative": (None, c_void_p, c_double, POINTER(c_double), POINTER(c_double)),
    "ts_jacobian": (None, c_void_p, c_double) + (POINTER(c_double),) * 4,
    "ts_string_law": (c_int, c_void_p, c_int32, c_double, POINTER(c_double)),
    "ts_breakpoints": (c_int, c_void_p, c_int32, POINTER(c_double), c_int32),
    "ts_piece_law": (c_int, c_void_p, c_int32, c_int32, c_double, POINTER(c_double)),
    "ts_curve_pieces": (c_int, c_void_p, c_int32, POINTER(_Piece), c_int32),
}


def load_library(path: Path | None = None) -> ctypes.CDLL:
    """The compiled kernel; path: the file, default beside this module's native sources."""
    path = Path(path) if path is not None else BESIDE / LIBRARY
    if not path.is_file():
        raise TensegrityError(f"the compiled kernel {path} is missing; install the package: pip install -e .")
    return _loaded(str(path), path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _loaded(path: str, changed: int) -> ctypes.CDLL:
    """A library with the types of its functions, which take longer than a small model; changed: when the file was, ns."""
    library = ctypes.CDLL(path)
    for name, (result, *arguments) in _PROTOTYPES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def _pointer(array: np.ndarray):
    return array.ctypes.data_as(POINTER(c_double))


def _bits(groups) -> int:
    if wrong := [group for group in groups if group not in GROUPS]:
        raise InputError(f"group = {wrong[0]!r} is not one of {', '.join(GROUPS)}")
    return sum(1 << GROUPS.index(group) for group in set(groups))


class _Handle:
    """Owns a simulation of the C library; views of its memory keep it alive."""

    def __init__(self, library: ctypes.CDLL, sim: int):
        self._library, self.sim = library, sim

    def __del__(self):
        self._library.ts_free(self.sim)

    def view(self, pointer, ctype, count: int) -> np.ndarray:
        """(count,) writable view of memory that belongs to the simulation."""
        buffer = (ctype * count).from_address(ctypes.addressof(pointer.contents))
        buffer._owner = self
        return np.frombuffer(buffer, dtype=np.dtype(ctype))


class Kernel:
    """One simulation.

    values: (n_real,) float64 view of inputs, parameters and outputs in the order of fields.FIELDS; integers: (n_int,)
    int32 view in the order of INTEGER_FIELDS; layout, integer_layout: name -> slice; counts: letter -> count.
    slopes: (2, inputs) view of the inputs' first and second derivatives by time, zero unless written: over a step an input is
    its value + slope t + bend t^2/2.
    Parameters written before `initialize` take effect there, inputs and tunables written between steps at the next step.
    A call that raises leaves the simulation as it was.
    """

    def __init__(self, model: Model | bytes, library: Path | None = None, **defaults):
        """model: a Model, or the bytes of model.to_bytes; defaults: method, tolerance, max_step, see to_bytes."""
        packed = model if isinstance(model, bytes) else to_bytes(model, **defaults)
        self._library = load_library(library)
        message = ctypes.create_string_buffer(256)
        self._sim = self._library.ts_create(packed, len(packed), message, len(message))
        if not self._sim:
            raise TensegrityError(f"the packed model is refused: {message.value.decode()}")
        self._handle = _Handle(self._library, self._sim)
        counts = (c_int32 * len(COUNTS))()
        self._library.ts_counts(self._sim, counts)
        self.counts = dict(zip(COUNTS, counts))
        self.layout, self.integer_layout = layout(self.counts), layout(self.counts, INTEGER_FIELDS)
        n_real, n_int = self.layout[FIELDS[-1].name].stop, self.integer_layout[INTEGER_FIELDS[-1].name].stop
        self.values = self._handle.view(self._library.ts_values(self._sim), c_double, n_real)
        self.integers = self._handle.view(self._library.ts_integers(self._sim), c_int32, n_int)
        inputs = self._library.ts_input_count(self._sim)
        self.slopes = self._handle.view(self._library.ts_slopes(self._sim), c_double, 2 * inputs).reshape(2, inputs)
        self.state_size = self._library.ts_state_size(self._sim)

    @property
    def time(self) -> float:
        """Time of the present state, s."""
        return self._library.ts_time(self._sim)

    @property
    def memory_size(self) -> int:
        """Bytes that the simulation occupies, without its force curves."""
        return self._library.ts_memory_size(self._sim)

    @property
    def first_output(self) -> int:
        """Where the outputs begin in `values`."""
        return next(self.layout[field.name].start for field in FIELDS if field.role == "output")

    def output_rates(self) -> np.ndarray:
        """First derivatives by time of all real outputs at the end of the last step, in the order of `values`, unit/s.

        Positions and velocities are exact, the others central differences along the motion (about 1e-6 relative).
        """
        out = np.empty(len(self.values) - self.first_output)
        self._require(self._library.ts_output_derivatives(self._sim, _pointer(out)))
        return out

    def output_derivatives(self) -> dict[str, np.ndarray]:
        """The same by name: field -> (count,)."""
        out, first = self.output_rates(), self.first_output
        return {name: out[at.start - first : at.stop - first] for name, at in self.layout.items() if at.start >= first}

    def __getitem__(self, name: str) -> np.ndarray:
        """View of a field: (count,) values; outputs of the present state, inputs and parameters to write to."""
        if name in self.layout:
            return self.values[self.layout[name]]
        return self.integers[self.integer_layout[name]]

    def _message(self) -> str:
        return self._library.ts_message(self._sim).decode()

    def _require(self, status: int) -> None:
        """Raises what a status of the kernel means."""
        if not status:
            return
        name = self._library.ts_status_name(status).decode()
        concerned = self._library.ts_concerned(self._sim) if name == "BAD_INPUT" else -1
        if concerned >= 0:
            raise self._refused(concerned)
        if name in ("BAD_INPUT", "BAD_STEP", "BAD_STATE"):
            raise InputError(self._message())
        raise SimulationError(name.lower(), self._message(), self.time)

    def place(self, index: int) -> tuple[str, int]:
        """Field and place within the field of an index of the block (integers follow the reals)."""
        for places, base in ((self.layout, 0), (self.integer_layout, len(self.values))):
            for name, at in places.items():
                if at.start <= index - base < at.stop:
                    return name, index - base - at.start
        raise IndexError(index)

    def check(self) -> None:
        """Raises InputError, naming field, place and value, where an input or parameter is outside its range."""
        index = c_int32(-1)
        if self._library.ts_check(self._sim, byref(index)):
            raise self._refused(index.value)

    def _refused(self, index: int) -> InputError:
        """What the kernel's message says of a value."""
        name, place = self.place(index)
        value = self[name][place].item()
        error = InputError(f"{name}[{place}] = {value!r} {self._message()}")
        error.index, error.reason = index, self._message()
        return error

    def reset(self) -> None:
        """Inputs, parameters and state as they were at first."""
        self._require(self._library.ts_reset(self._sim))

    def initialize(self, time: float = 0.0) -> None:
        """Return to the scene's start at this time (s) under the present inputs and parameters; fills the outputs."""
        self._require(self._library.ts_initialize(self._sim, number("time", time)))

    def step(self, h: float) -> None:
        """Advance by h > 0 (s) under the present inputs and tunables; fills the outputs.

        Raises InputError (a value outside its range, a bad h) or SimulationError (status says why).
        """
        status = self._library.ts_step(self._sim, h if type(h) is float else number("h", h))
        if status:
            self._require(status)

    def watched_step(self, h: float, watcher: Callable[[bool], object]) -> float:
        """A `step` that may end early; returns how far it went, s.

        watcher: called with False where an internal step ended before the call's end, with True where there were transitions,
        after them; where it returns something true, the step ends there.  It may look: `time`, `transitions`, `look`,
        `output_rates`; inputs and parameters must stay, and all else is refused.  Inputs that move do so anew from the start of
        the step that follows.  Where it raises, the step is undone.
        """
        raised: list[BaseException] = []

        def told(context, sim, moment):
            try:
                return _END_HERE if watcher(moment == _AT_TRANSITION) else _GO_ON
            except BaseException as error:
                raised.append(error)
                return _GIVE_UP

        done = c_double()
        status = self._library.ts_step_watched(self._sim, number("h", h), _WATCHER(told), None, byref(done))
        if raised:
            raise raised[0]
        self._require(status)
        return done.value

    def want(self, *groups: str) -> None:
        """Which of GROUPS a `step` fills with outputs, at first all of them; the others stay as they are until `fill`."""
        self._library.ts_want(self._sim, _bits(groups))

    def fill(self, *groups: str) -> None:
        """Bring the outputs of these GROUPS, or of all, to the end of the last step; whatever has been written to inputs since,
        they are what `step` would have filled.  Raises SimulationError where they are not finite."""
        self._require(self._library.ts_fill(self._sim, _bits(groups or GROUPS)))

    def take_inputs(self) -> None:
        """Take inputs and tunable parameters that differ from the last step's at once, as a step that begins now would: what
        jumps is booked, and the outputs follow.  Inputs that move and have not been set since are carried first.  Raises
        InputError, and nothing has changed."""
        self._require(self._library.ts_take_inputs(self._sim))

    def look(self) -> None:
        """Within a watcher: fill the outputs of the moment."""
        self._require(self._library.ts_look(self._sim))

    def save(self) -> bytes:
        """The complete state."""
        buffer = ctypes.create_string_buffer(self.state_size)
        self._require(self._library.ts_save(self._sim, buffer, self.state_size))
        return buffer.raw

    def restore(self, state: bytes) -> None:
        """Back to a saved state, to the last bit.  Raises InputError for bytes of another model or version, or damaged."""
        self._require(self._library.ts_restore(self._sim, state, len(state)))

    @property
    def transitions(self) -> list[Transition]:
        """Transitions of the last step, the first 4096 of them; `transition_count` says how many there were."""
        stored = self._library.ts_transition_stored(self._sim)
        records = self._library.ts_transitions(self._sim)
        return [Transition(r.time, r.string, r.before, r.after, r.loss, r.contact) for r in records[:stored]]

    def consequence(self, transition: Transition) -> str:
        """What a transition means for its string: 'slack', 'taut', how many of its NSH's beams are snapped where that changes,
        what a snap loses, or '' (a kink of the force curve); of a contact its kind."""
        if transition.contact >= 0:
            return transition.kind
        pieces = transition.before, transition.after
        before, after = (self.snapped_on(transition.string, piece) for piece in pieces)
        found = []
        if 0 in pieces and pieces != (0, 0):
            found.append("slack" if transition.after == 0 else "taut")
        elif after != before:
            found.append(f"{after} snapped")
        if transition.loss > 0.0:
            found.append(f"{transition.loss!r} J lost")
        return ", ".join(found)

    def snapped_on(self, string: int, piece: int) -> int:
        """Beams of a string that are past their force maximum on a piece, as transitions have it."""
        return self._library.ts_snapped(self._sim, string, piece)

    @property
    def transition_count(self) -> int:
        """Transitions of the last step."""
        return self._library.ts_transition_count(self._sim)

    @property
    def stats(self) -> dict[str, int]:
        """Counters since `initialize`."""
        counts = (c_int64 * len(STATS))()
        self._library.ts_stats(self._sim, counts)
        return dict(zip(STATS, counts))

    @property
    def state(self) -> np.ndarray:
        """Generalised state [q, q', dissipated, input work, throughput]; see native/motion/motion.c."""
        y = np.empty(self._library.ts_state_length(self._sim))
        self._library.ts_get_state(self._sim, _pointer(y))
        return y

    def _state(self, y: np.ndarray) -> np.ndarray:
        return array_of("the state", y, (self._library.ts_state_length(self._sim),))

    def _string(self, string: int) -> int:
        string = int(string)
        if not 0 <= string < self.counts["S"]:
            raise InputError(f"string = {string!r}: there are {self.counts['S']} strings, counted from 0")
        if self._library.ts_breakpoints(self._sim, string, None, 0) < 0:
            self.check()
        return string

    def locate_transitions(self, on: bool) -> None:
        """Analysis only.  False: transitions are no longer located, every evaluation takes the strings' law as one formula,
        as a solver without events does."""
        self._library.ts_locate(self._sim, int(on))

    def derivative(self, y: np.ndarray, tau: float = 0.0) -> np.ndarray:
        """Right-hand side at a state under the present pieces; tau: time since the last communication point, s."""
        y = self._state(y)
        dy = np.empty_like(y)
        self._library.ts_derivative(self._sim, number("tau", tau), _pointer(y), _pointer(dy))
        return dy

    def jacobian(self, y: np.ndarray, tau: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of the accelerations by q, q' (n, n) and t (n,)."""
        y, n = self._state(y), (len(y) - 3) // 2
        Jq, Jv, ft = np.empty((n, n)), np.empty((n, n)), np.empty(n)
        self._library.ts_jacobian(self._sim, number("tau", tau), *(_pointer(a) for a in (y, Jq, Jv, ft)))
        return Jq, Jv, ft

    def string_law(self, string: int, elongation: float) -> tuple[float, float, float, int]:
        """Elastic tension (N), stiffness (N/m), energy (J) and piece of a string at an elongation (m); where it has memory, on
        a first loading."""
        out = np.empty(3)
        piece = self._library.ts_string_law(self._sim, self._string(string), number("elongation", elongation), _pointer(out))
        return out[0], out[1], out[2], piece

    def piece_law(self, string: int, piece: int, elongation: float) -> tuple[float, float, float]:
        """Elastic tension (N), stiffness (N/m) and energy (J) of a string on one of its pieces, continued past its ends."""
        out, at = np.empty(3), number("elongation", elongation)
        if self._library.ts_piece_law(self._sim, self._string(string), int(piece), at, _pointer(out)) < 0:
            raise InputError(f"piece = {piece!r}: string {string} has {len(self.pieces(string))} pieces, counted from 0")
        return out[0], out[1], out[2]

    def pieces(self, string: int) -> list[Piece]:
        """The pieces of a string's force curve, the first of them slack: a chain in the elongation, or a graph where the string
        has memory."""
        count = self._library.ts_curve_pieces(self._sim, self._string(string), None, 0)
        rows = (_Piece * count)()
        self._library.ts_curve_pieces(self._sim, int(string), rows, count)
        return [Piece(r.lo, r.hi, r.up, r.down, r.loss_up, r.loss_down, r.snapped, bool(r.slack)) for r in rows]

    def breakpoints(self, string: int) -> np.ndarray:
        """Elongations (m) at the ends of the pieces of a string's force curve, from 0; where it has memory, on a first
        loading."""
        out = np.empty(self._library.ts_breakpoints(self._sim, self._string(string), None, 0))
        self._library.ts_breakpoints(self._sim, int(string), _pointer(out), len(out))
        return out
