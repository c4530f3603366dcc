"""The FMU's life cycle over the kernel, as a slave of pythonfmu.

Inside an FMU this file stands in a package with a private name, beside a copy of the core (see pack.py); it is not
imported from the source tree.

The hooks are pythonfmu's, and a few more: the FMU's library (fmi2.c) calls one for each of FMI's functions.  Value references
and values come as memoryviews of C's types ('I', 'i', 'd'), None for a null pointer, and go as arrays.  A hook returns None or
a status, or raises Refused, whose status the host gets: fmi2Discard where something is refused and the instance stays as it
was; fmi2Error where host and FMU have parted (then only a reset, a saved state or the end help).  Any other exception is a
fault of the FMU, and fmi2Error, too.  docs/fmu.md has the table of statuses, which is that of the native FMU.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..errors import InputError, SimulationError
from ..kernel import Kernel
from ..pythonfmu.enums import Fmi2Status
from ..pythonfmu.fmi2slave import Fmi2Slave
from .state import ERROR, INITIALIZATION, INSTANTIATED, READING, SETTING, STEPPING, TERMINATED, State, StateError
from .table import Table, number

#: Messages about transitions in one step; a chattering string could otherwise fill the host's log.
MAX_EVENTS = 1000

#: Categories of messages: those that are always logged, and those that the host must ask for.
ALWAYS, ASKED = ("logStatusWarning", "logStatusDiscard", "logStatusError"), ("logEvents", "logSolver")

MODE_NAMES = {
    INSTANTIATED: "before fmi2EnterInitializationMode",
    INITIALIZATION: "in Initialization Mode",
    STEPPING: "after fmi2ExitInitializationMode",
    TERMINATED: "after fmi2Terminate",
    ERROR: "after an error; reset the instance or put a saved state back",
}

#: Relative round-off of a time that a host counts.
ROUND_OFF = 4.0 * sys.float_info.epsilon

#: fmi2LastSuccessfulTime and fmi2Terminated of fmi2StatusKind.
LAST_SUCCESSFUL_TIME, TERMINATED_STATUS = 2, 3


class Refused(Exception):
    """A call that is not carried out.  status: what the host gets."""

    def __init__(self, status: Fmi2Status, message: str):
        super().__init__(message)
        self.status = status


def slack(time: float, h: float) -> float:
    """Round-off that a communication point may have, s: the host counts its own time."""
    return 1e-6 * h + ROUND_OFF * abs(time)


def content(path: Path) -> bytes:
    """Of a file in the resources."""
    try:
        return path.read_bytes()
    except OSError as error:
        remedy = "unzip the FMU anew, and pass the URI of its resources folder"
        raise Refused(Fmi2Status.error, f"{path} cannot be read ({error.strerror}); {remedy}") from error


class TensegritySlave(Fmi2Slave):
    """One instance of an FMU."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        resources = Path(self.resources)
        self._table = Table(json.loads(content(resources / "variables.json")))
        library = resources / __name__.split(".")[0] / self._table.library
        self._kernel = Kernel(content(resources / "model.bin"), library.absolute())
        self._values, self._integers = self._kernel.values, self._kernel.integers
        self._memory = memoryview(self._values)
        self._state = State()
        self._rates = None  # derivatives of the outputs at the end of the last step, once they were asked for
        self._own_tolerance = self._values[self._table.tolerance].item()
        self._asked = dict.fromkeys(ASKED, False)

    def check_guid(self, guid: str):
        if guid != self._table.guid:
            raise Refused(Fmi2Status.error, f"the GUID {guid[:100]} is not that of this FMU, {self._table.guid}")

    def set_debug_logging(self, on: bool, categories: list[str] | None):
        if categories is None:
            self.null_pointer("fmi2SetDebugLogging")
        self._asked.update(dict.fromkeys(ASKED, on and not categories))
        self._asked.update({name: on for name in categories if name in ASKED})
        unknown = [name for name in categories if name not in ALWAYS + ASKED]
        for name in unknown:
            self.log(f"fmi2SetDebugLogging: there is no log category {name or '(null)'}", Fmi2Status.warning)
        return Fmi2Status.warning if unknown else None

    # Refusals: exceptions to be raised

    def _refused(self, what, why):
        return Refused(Fmi2Status.discard, f"{what} refused: {why}")

    def _error(self, what, why):
        self.fail()
        return Refused(Fmi2Status.error, f"{what}: {why}")

    def _out_of_order(self, what):
        """A call in a mode in which it must not be made; one that moves nothing on does no harm, but after an error."""
        why = f"must not be called {MODE_NAMES[self._state.mode]}"
        return self._error(what, why) if self._state.mode == ERROR else self._refused(what, why)

    def null_pointer(self, what) -> NoReturn:
        raise self._refused(what, "a null pointer was passed")

    def short_vector(self) -> NoReturn:
        raise self._refused("fmi2SerializeFMUstate", "the vector is too short; ask fmi2SerializedFMUstateSize")

    def fail(self):
        """Only a reset or a saved state leads on."""
        self._state.mode = ERROR

    # Life cycle

    def _move(self, what, source, target):
        if self._state.mode != source:
            raise self._error(what, f"must not be called {MODE_NAMES[self._state.mode]}")
        self._state.mode = target

    def setup_experiment(self, start_time, stop_time=None, tolerance=None):
        what, state = "fmi2SetupExperiment", self._state
        self._move(what, INSTANTIATED, INSTANTIATED)
        if not math.isfinite(start_time):
            raise self._refused(what, "the start time is not a finite number")
        if stop_time is not None and not stop_time >= start_time:
            raise self._refused(what, "the stop time lies before the start time")
        state.time = state.start = start_time
        state.stop = math.inf if stop_time is None else stop_time
        if tolerance is None or state.tolerance_set:
            return
        self._take_tolerance(what, tolerance)

    def _take_tolerance(self, what, tolerance):
        """A host's tolerance may tighten the FMU's own and not loosen it: hosts that pass a default of theirs, often 1e-4,
        would lose the promised accuracy unasked.  Only logged, since some hosts take fmi2Warning here for a failure."""
        reference, own = self._table.tolerance, self._own_tolerance
        given = f"{what}: the tolerance {number(tolerance)} is"
        if not self._table.accepts(reference, tolerance):
            self.log(f"{given} out of range: ignored", Fmi2Status.warning)
            return
        self._values[reference] = min(tolerance, own)
        if tolerance > own:
            needed = f"looser than {number(own)}, which the promised accuracy needs and which is used"
            self.log(f"{given} {needed}; to loosen it, set solver.tolerance", Fmi2Status.warning)

    def enter_initialization_mode(self):
        self._move("fmi2EnterInitializationMode", INSTANTIATED, INITIALIZATION)
        self._state.stale = True

    def exit_initialization_mode(self):
        what = "fmi2ExitInitializationMode"
        self._move(what, INITIALIZATION, INITIALIZATION)
        self._refresh(what, "; the start values must be mended")
        self._state.mode = STEPPING

    def terminate(self):
        self._move("fmi2Terminate", STEPPING, TERMINATED)
        if self._asked["logSolver"]:
            self._log_solver()

    def reset(self):
        self._kernel.reset()
        self._state, self._rates = State(), None

    def _refresh(self, what, remedy=""):
        """Initialization Mode: outputs follow inputs and parameters at once, computed when somebody looks."""
        if not self._state.stale:
            return
        try:
            self._kernel.check()
            self._kernel.initialize(self._state.start)
        except (InputError, SimulationError) as error:
            why = f"{what}: no start can be computed: {self._explain(error)}{remedy}"
            raise Refused(Fmi2Status.discard, why) from error
        self._state.stale, self._rates = False, None

    def _log_solver(self):
        s = self._kernel.stats
        work = f"{s['steps']} steps ({s['implicit_steps']} implicit), {s['rejected']} rejected, {s['rhs']} right-hand sides"
        text = f"since the start: {work}, {s['jacobians']} Jacobians, {s['transitions']} transitions"
        self.log(text, Fmi2Status.ok, "logSolver")

    # Steps

    def do_step(self, current_time, step_size):
        state, what = self._state, "fmi2DoStep"
        if state.mode != STEPPING:
            self._move(what, STEPPING, STEPPING)
        if not 0.0 < step_size < math.inf:
            raise self._discarded(current_time, f"the step size {number(step_size)} s is not positive and finite")
        if not abs(current_time - state.time) <= slack(state.time, step_size):
            where = f"the communication point is {number(current_time)} s, but the FMU stands at {number(state.time)} s"
            raise self._error(what, where)
        if current_time + step_size > state.stop + self._slack_at_stop(step_size):
            step = f"the step from {number(current_time)} s would pass the stop time {number(state.stop)} s"
            raise self._error(what, step)
        try:
            self._kernel.step(step_size)
        except (InputError, SimulationError) as error:
            raise self._discarded(current_time, self._explain(error)) from error
        state.time, state.discarded, self._rates = current_time + step_size, False, None
        if self._asked["logEvents"] and self._kernel.transition_count:
            self._log_events()
        return True

    def _slack_at_stop(self, h):
        """Round-off that the last step may have, s: a host that adds up its time has rounded it at each step, which is much at
        large times; but less than half a step, or it is a step too many."""
        state = self._state
        if state.stop == math.inf:
            return 0.0
        steps = (state.time - state.start) / h
        return max(slack(state.stop, h), min(0.5 * h, 0.25 * steps * ROUND_OFF * abs(state.stop)))

    def _discarded(self, time, why):
        self._state.discarded = True
        return Refused(Fmi2Status.discard, f"the step from t = {number(time)} s is discarded: {why}")

    def _log_events(self):
        for transition in self._kernel.transitions[:MAX_EVENTS]:
            touches = transition.contact >= 0
            what = f"string {self._table.strings[transition.string]}: piece" if not touches else ""
            meaning = self._kernel.consequence(transition)
            when = f"{transition.before} -> {transition.after} at t = {number(transition.time)} s"
            what = what or f"contact {self._table.contacts[transition.contact]}:"
            self.log(f"{what} {when}{f', {meaning}' if meaning else ''}", Fmi2Status.ok, "logEvents")
        more = self._kernel.transition_count - MAX_EVENTS
        if more > 0:
            self.log(f"{more} more transitions in this step", Fmi2Status.ok, "logEvents")

    def cancel_step(self):
        raise self._refused("fmi2CancelStep", "no step is under way: fmi2DoStep returns when it is done, never fmi2Pending")

    def get_status(self, kind):
        raise self._not_pending("fmi2GetStatus")

    def get_integer_status(self, kind):
        raise self._not_pending("fmi2GetIntegerStatus")

    def get_string_status(self, kind):
        raise self._not_pending("fmi2GetStringStatus")

    def get_real_status(self, kind):
        if kind != LAST_SUCCESSFUL_TIME or not self._state.mode & (STEPPING | TERMINATED):
            raise self._not_pending("fmi2GetRealStatus")
        return self._state.time

    def get_boolean_status(self, kind):
        """After a discarded step an importer asks whether to end the run: yes, until a step succeeds."""
        if kind != TERMINATED_STATUS or not self._state.mode & (STEPPING | TERMINATED):
            raise self._not_pending("fmi2GetBooleanStatus")
        return self._state.discarded

    def _not_pending(self, what):
        if not self._state.mode & (STEPPING | TERMINATED):
            return self._out_of_order(what)
        return self._refused(what, "no step is ever pending here")

    # Values

    def _readable(self, what, references):
        if not self._state.mode & READING:
            raise self._out_of_order(what)
        if references is None:
            self.null_pointer(what)

    def get_real(self, references):
        """Some importers read every output as a Real; references are unique over the types, so that an integer is clear."""
        what = "fmi2GetReal"
        self._readable(what, references)
        group = self._table.reals.group(references)
        if group is None:
            self._require(what, "Real", references, lambda i: i in self._table.reals or i in self._table.integers)
        if len(references) and self._state.mode == INITIALIZATION:
            self._refresh(what)
        if group is not None:
            return self._values[group.index]
        return np.array([self._value(reference) for reference in references], dtype=float)

    def get_integer(self, references):
        what, block = "fmi2GetInteger", self._table.integers
        self._readable(what, references)
        group = block.group(references)
        if group is None:
            self._require(what, "Integer", references, block.__contains__)
        if len(references) and self._state.mode == INITIALIZATION:
            self._refresh(what)
        return self._integers[group.index] if group is not None else self._integers[:0]

    def _value(self, reference):
        first = self._table.integers.first
        return self._values[reference].item() if reference < first else self._integers[reference - first].item()

    def _require(self, what, kind, references, known):
        for reference in references:
            if not known(reference):
                raise self._refused(what, f"no {kind} variable has the value reference {reference}")

    def set_real(self, references, values):
        self._set("fmi2SetReal", self._table.reals, self._values, references, values)

    def set_integer(self, references, values):
        self._set("fmi2SetInteger", self._table.integers, self._integers, references, values)

    def _settable(self, what, *arrays):
        if not self._state.mode & SETTING:
            raise self._out_of_order(what)
        if None in arrays:
            self.null_pointer(what)

    def _set(self, what, block, target, references, values):
        """Set all or nothing."""
        self._settable(what, references, values)
        group, mode = block.group(references), self._state.mode
        if group is None:
            self._require(what, block.kind, references, block.__contains__)
            return
        if not (group.settable & mode and group.surely_accepts(values)):
            for reference, value in zip(references, values):
                self._judge(what, reference, value, target[reference - block.first].item())
        if target is self._values and type(group.index) is slice:
            self._memory[group.index] = values  # the same, without NumPy's detour
        else:
            target[group.index] = values
        if mode != STEPPING:
            self._note_early(references)

    def _judge(self, what, reference, value, present):
        """Raises where the variable may not take the value now."""
        name, settable = self._table.names[reference], self._table.settable[reference]
        if not settable & self._state.mode:
            if value != present:
                why = "a fixed parameter cannot change after initialization" if settable else "it is an output"
                raise self._refused(what, f"{name} = {number(value)}: {why}")
        elif not self._table.accepts(reference, value):
            kept = f"{name} = {number(value)} refused, {number(present)} kept"
            raise Refused(Fmi2Status.discard, f"{what}: {kept}: {self._table.bounds(reference)}")

    def _note_early(self, references):
        """Values set before the first step change the start."""
        self._state.stale = self._state.mode == INITIALIZATION
        if self._table.tolerance in references.tolist():
            self._state.tolerance_set = True

    def get_boolean(self, references):
        return self._get_none("fmi2GetBoolean", "Boolean", references)

    def get_string(self, references):
        return self._get_none("fmi2GetString", "String", references)

    def set_boolean(self, references, values):
        self._set_none("fmi2SetBoolean", "Boolean", references, values)

    def set_string(self, references, values):
        self._set_none("fmi2SetString", "String", references, values)

    def _get_none(self, what, kind, references):
        self._readable(what, references)
        self._require(what, kind, references, lambda reference: False)
        return []

    def _set_none(self, what, kind, references, values):
        self._settable(what, references)
        self._require(what, kind, references, lambda reference: False)

    # Derivatives

    def set_real_input_derivatives(self, references, orders, values):
        """They hold until they are set again, like the inputs themselves."""
        what, slopes = "fmi2SetRealInputDerivatives", self._kernel.slopes
        self._settable(what, references, orders, values)
        inputs = slopes.shape[1]
        self._require(what, "input", references, lambda i: i < inputs and i in self._table.reals)
        for reference, order, value in zip(references, orders, values):
            if order not in (1, 2):
                raise self._refused(what, "only derivatives of order 1 and 2 are used")
            if not math.isfinite(value):
                which = f"derivative {order} of {self._table.names[reference]} = {number(value)}"
                raise Refused(Fmi2Status.discard, f"{what}: {which} refused: it must be finite")
        for reference, order, value in zip(references, orders, values):
            slopes[order - 1, reference] = value
        self._state.stale |= self._state.mode == INITIALIZATION

    def get_real_output_derivatives(self, references, orders):
        what, first = "fmi2GetRealOutputDerivatives", self._kernel.first_output
        if not self._state.mode & (STEPPING | TERMINATED | ERROR):
            raise self._out_of_order(what)
        if references is None or orders is None:
            self.null_pointer(what)
        self._require(what, "Real output", references, lambda i: i >= first and i in self._table.reals)
        if any(order != 1 for order in orders):
            raise self._refused(what, "only derivatives of order 1 are given")
        if self._rates is None:
            try:
                self._rates = self._kernel.output_rates()
            except (InputError, SimulationError) as error:
                raise self._refused(what, str(error)) from error
        return self._rates[np.array(references, dtype=np.int64) - first]

    def get_directional_derivative(self):
        what = "fmi2GetDirectionalDerivative"
        if not self._state.mode & READING:
            raise self._out_of_order(what)
        raise self._refused(what, "directional derivatives are not provided: no output depends directly on an input")

    # FMU state: bytes, complete, bound to this FMU

    def _get_fmu_state(self):
        return self._state.pack(self._table.identity, self._kernel.save())

    def _unpacked(self, what, state):
        try:
            return State.unpack(self._table.identity, state, self._kernel.state_size)
        except StateError as error:
            raise self._refused(what, error) from error

    def _set_fmu_state(self, state):
        mine, kernel = self._unpacked("fmi2SetFMUstate", state)
        self._kernel.restore(kernel)
        self._state, self._rates = mine, None

    def _fmu_state_to_bytes(self, state, what="fmi2SerializeFMUstate"):
        self._unpacked(what, state)
        return state

    def _fmu_state_from_bytes(self, state):
        self._unpacked("fmi2DeSerializeFMUstate", state)
        return state

    # Messages

    def _explain(self, error):
        """The message of a kernel error, with the variable that it concerns, whose place it carries as `index`."""
        if not hasattr(error, "index"):
            return str(error)
        values = self._kernel.values
        value = f" = {number(values[error.index])}" if error.index < len(values) else ""
        return f"{self._table.names[error.index]}{value} {error.reason}"
