"""The FMU's life cycle over the kernel, as a slave of pythonfmu.

Inside an FMU this file stands in a package with a private name, beside a copy of the core (see pack.py); it is not
imported from the source tree.

pythonfmu's binary turns an exception into fmi2Fatal and cannot return fmi2Error.  So no hook lets an exception out:
what cannot be done is logged and refused, the value that was there stays, and the next step is discarded.  A refused
*value* discards every step until a good one is set in its place.
"""

from __future__ import annotations

import json
import math
import sys
import traceback
from functools import wraps
from operator import le
from pathlib import Path

from ..errors import InputError, SimulationError
from ..kernel import Kernel
from ..pythonfmu.enums import Fmi2Status
from ..pythonfmu.fmi2slave import Fmi2Slave
from .state import INITIALIZATION, INSTANTIATED, STEPPING, TERMINATED, State, StateError
from .table import Group, Table

#: Messages about transitions in one step; a chattering string could otherwise fill the host's log.
MAX_EVENTS = 1000


def guarded(failed):
    """Decorator of a hook: an exception is logged and discards the next step; failed(*arguments) is returned."""

    def decorate(hook):
        @wraps(hook)
        def safe(self, *arguments):
            try:
                return hook(self, *arguments)
            except Exception as error:  # the binary would make it fmi2Fatal
                self._fault(hook.__name__, error)
                return failed(*arguments)

        return safe

    return decorate


def nothing(*_):
    return None


def false(*_):
    return False


class TensegritySlave(Fmi2Slave):
    """One instance of an FMU.  Raises in the constructor only, where the host sees that fmi2Instantiate failed."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        resources = Path(self.resources)
        self._table = Table(json.loads((resources / "variables.json").read_text(encoding="utf-8")))
        library = resources / __name__.split(".")[0] / self._table.library
        self._kernel = Kernel((resources / "model.bin").read_bytes(), library.absolute())
        self._values, self._integers = self._kernel.values, self._kernel.integers
        self._state = State()
        self._stale = False
        self._own_tolerance = self._values[self._table.tolerance].item()
        self._forget_resources_on_path()

    def _forget_resources_on_path(self):
        """The binary puts the folder on sys.path at every instantiation; everything is imported by now."""
        if self.resources in sys.path:
            sys.path.remove(self.resources)

    # Life cycle

    @guarded(nothing)
    def setup_experiment(self, start_time, stop_time=None, tolerance=None):
        state = self._state
        state.time = state.start = start_time
        state.stop = math.inf if stop_time is None else stop_time
        if tolerance is None or state.tolerance_set:
            return
        self._take_tolerance(tolerance)

    def _take_tolerance(self, tolerance):
        """A host's tolerance may tighten the FMU's own and not loosen it: hosts that pass a default of theirs, often 1e-4,
        would lose the promised accuracy unasked."""
        reference, own = self._table.tolerance, self._own_tolerance
        what = f"fmi2SetupExperiment: the tolerance {tolerance!r} is"
        if not self._table.accepts(reference, tolerance):
            self._log(Fmi2Status.warning, f"{what} out of range: ignored")
            return
        self._values[reference] = min(tolerance, own)
        if tolerance > own:
            needed = f"looser than {own!r}, which the promised accuracy needs and which is used"
            self._log(Fmi2Status.warning, f"{what} {needed}; to loosen it, set solver.tolerance")

    @guarded(nothing)
    def enter_initialization_mode(self):
        self._state.mode = INITIALIZATION
        self._refresh()

    @guarded(nothing)
    def exit_initialization_mode(self):
        if self._stale:
            self._refresh()
        self._state.mode = STEPPING

    @guarded(nothing)
    def terminate(self):
        self._state.mode = TERMINATED

    def _refresh(self):
        """Compute the start anew from the present inputs and parameters."""
        self._stale = False
        self._state.initialized = False
        try:
            self._kernel.initialize(self._state.start)
            self._state.initialized = True
        except (InputError, SimulationError) as error:
            self._refuse(f"no start can be computed: {self._explain(error)}")

    # Steps

    @guarded(false)
    def do_step(self, current_time, step_size):
        state = self._state
        if not self._may_step(current_time, step_size):
            return False
        if not state.initialized:
            self._refresh()
            if not state.initialized:
                state.pending = False
                return False
        try:
            self._kernel.step(step_size)
        except (InputError, SimulationError) as error:
            why = self._explain(error, step_size)
            self._log(Fmi2Status.discard, f"step from t = {current_time!r} s discarded: {why}")
            return False
        state.time = current_time + step_size
        if self._kernel.transition_count:
            self._log_events()
        return True

    def _may_step(self, current_time, step_size) -> bool:
        """Whether a step may be tried; logs why not."""
        state = self._state
        why = None
        if state.mode != STEPPING:
            why = "the FMU is not in step mode (before fmi2ExitInitializationMode or after fmi2Terminate)"
        elif state.refused:
            names = ", ".join(self._table.names[reference] for reference in sorted(state.refused)[:8])
            why = f"a refused value has not been mended: {names}"
        elif state.pending:
            why = "a call before it was refused, see the log"
        elif not (0.0 < step_size < math.inf):
            why = f"the step size {step_size!r} s is not positive and finite"
        elif not abs(current_time - state.time) <= 1e-6 * step_size + 4.0 * math.ulp(state.time):
            why = f"the FMU stands at t = {state.time!r} s"
        elif current_time + step_size > state.stop + 1e-6 * step_size + 4.0 * math.ulp(state.stop):
            why = f"it would pass the stop time {state.stop!r} s"
        state.pending = False
        if why is None:
            return True
        self._log(Fmi2Status.discard, f"step from t = {current_time!r} s discarded: {why}")
        return False

    def _log_events(self):
        for transition in self._kernel.transitions[:MAX_EVENTS]:
            string = self._table.strings[transition.string]
            meaning = self._kernel.consequence(transition)
            what = f"{transition.before} -> {transition.after} at t = {transition.time!r} s" + (f", {meaning}" if meaning else "")
            self._log(Fmi2Status.ok, f"string {string}: piece {what}", "logEvents")
        more = self._kernel.transition_count - MAX_EVENTS
        if more > 0:
            self._log(Fmi2Status.ok, f"{more} more transitions in this step", "logEvents")

    # Values

    @guarded(lambda references: [math.nan] * len(references))
    def get_real(self, references):
        if self._stale:
            self._refresh()
        group = self._table.reals.group(references)
        if group is not None:
            return self._values[group.index].tolist()
        return [self._get_as_real(i) for i in references]

    @guarded(lambda references: [0] * len(references))
    def get_integer(self, references):
        if self._stale:
            self._refresh()
        group = self._table.integers.group(references)
        if group is not None:
            return self._integers[group.index].tolist()
        return [self._get_one(self._table.integers, self._integers, i, 0) for i in references]

    def _get_as_real(self, reference):
        """Some importers read every output as a Real; references are unique over the types, so that an integer is clear."""
        if reference in self._table.integers:
            return float(self._integers[reference - self._table.integers.first])
        return self._get_one(self._table.reals, self._values, reference, math.nan)

    def _get_one(self, block, values, reference, missing):
        if reference in block:
            return values[reference - block.first].item()
        self._refuse(f"no {block.kind} variable has the value reference {reference}")
        return missing

    @guarded(nothing)
    def set_real(self, references, values):
        self._set(self._table.reals, self._values, references, values)

    @guarded(nothing)
    def set_integer(self, references, values):
        self._set(self._table.integers, self._integers, references, values)

    def _set(self, block, target, references, values):
        group: Group | None = block.group(references)
        state = self._state
        if group is not None and group.settable >= state.mode:
            if all(map(le, group.low, values)) and all(map(le, values, group.high)):  # false for NaN
                target[group.index] = values
                if state.refused:
                    state.refused.difference_update(references)
                if state.mode != STEPPING:
                    self._note_early(references)
                return
        for reference, value in zip(references, values):
            self._set_one(block, target, reference, value)
        if state.mode != STEPPING:
            self._note_early(references)

    def _set_one(self, block, target, reference, value):
        if reference not in block:
            self._refuse(f"no {block.kind} variable has the value reference {reference}")
            return
        name = self._table.names[reference]
        settable = self._table.settable[reference]
        if settable < self._state.mode:
            if target[reference - block.first] == value:
                self._state.refused.discard(reference)  # mended: it is the value that was kept
            else:
                self._refuse(f"{name} = {value!r} refused: {self._why_not(settable)}")
        elif not self._table.accepts(reference, value):
            self._state.refused.add(reference)
            self._log(Fmi2Status.discard, f"{name} = {value!r} refused: {self._table.range_of(reference)}")
        else:
            target[reference - block.first] = value
            self._state.refused.discard(reference)

    def _why_not(self, settable):
        if self._state.mode == TERMINATED:
            return "the FMU has been terminated"
        if settable < INSTANTIATED:
            return "it is an output"
        return "a fixed parameter cannot change after initialization; reset the FMU first"

    def _note_early(self, references):
        """Values set before the first step change the start."""
        self._stale = self._state.mode == INITIALIZATION
        if self._table.tolerance in references:
            self._state.tolerance_set = True

    def get_boolean(self, references):
        return [False] * self._no_such(references, "Boolean")

    def get_string(self, references):
        return [""] * self._no_such(references, "String")

    def set_boolean(self, references, values):
        self._no_such(references, "Boolean")

    def set_string(self, references, values):
        self._no_such(references, "String")

    def _no_such(self, references, kind):
        if references:
            self._refuse(f"this FMU has no {kind} variables")
        return len(references)

    # FMU state: bytes, complete, bound to this FMU

    @guarded(lambda: b"")
    def _get_fmu_state(self):
        if self._stale:
            self._refresh()
        return self._state.pack(self._table.identity, self._kernel.save())

    @guarded(nothing)
    def _set_fmu_state(self, state):
        try:
            mine, kernel = State.unpack(self._table.identity, state)
        except StateError as error:
            self._refuse(f"the FMU state was refused: {error}")
            return
        self._kernel.restore(kernel)
        self._state, self._stale = mine, False

    @staticmethod
    def _fmu_state_to_bytes(state):
        return state if isinstance(state, bytes) else b""

    @staticmethod
    def _fmu_state_from_bytes(state):
        return state

    # Messages

    def _explain(self, error, step_size=0.0):
        """The message of a kernel error, with the variables that it concerns: the one whose place it carries as
        `index`, or the rest lengths that would turn negative within the step.
        """
        kernel, names = self._kernel, self._table.names
        concerned = [error.index] if hasattr(error, "index") else []
        if isinstance(error, InputError) and not concerned:
            end = kernel["rest_length"] + step_size * kernel["rest_length_rate"]
            concerned = [kernel.layout["rest_length"].start + int(i) for i in (end < 0.0).nonzero()[0]]
        return ": ".join([", ".join(names[i] for i in concerned[:8]), str(error)] if concerned else [str(error)])

    def _refuse(self, message):
        self._state.pending = True
        self._log(Fmi2Status.discard, message)

    def _fault(self, where, error):
        self._state.pending = True
        place = traceback.extract_tb(error.__traceback__)[-1]
        self._log(
            Fmi2Status.error,
            f"fault in {where} ({Path(place.filename).name}:{place.lineno}): {type(error).__name__}: {error}",
        )

    def _log(self, status, message, category=None):
        """Queue a message.  The host treats it as a format of printf, and reads it as UTF-8."""
        text = message.replace("%", "%%").encode("utf-8", "replace").decode("utf-8")
        self.log(text, status, category or f"logStatus{status.name.capitalize()}")
