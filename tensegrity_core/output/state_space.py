"""A linear system as scripts use it: its matrices with names and units, parts of it, and its files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..equilibria.linearization import Linear, Quantity
from ..errors import InputError, nearest
from ..files import replacing, write_text
from ..model import Model
from ..quantities import number
from .export import require_writable

#: What an input's name has where its rate's has something else.
RATES = {".rest_length": ".rest_length_rate", ".position.": ".velocity.", ".velocity.": ".acceleration."}


@dataclass(frozen=True, eq=False)
class StateSpace(Linear):
    """A linear system with its parts and files.  scene: its name; the other fields are those of `Linear`, deviations from an
    operating point: A, B, C, D, drift; states, inputs, outputs with names, units and values there; strings."""

    scene: str

    @classmethod
    def of(cls, scene: str, linear: Linear) -> StateSpace:
        return cls(**vars(linear), scene=scene)

    @property
    def poles(self) -> np.ndarray:
        """(n,) complex 1/s: eigenvalues of A."""
        return np.linalg.eigvals(self.A) if len(self.A) else np.zeros(0, dtype=complex)

    def response(self, s: complex) -> np.ndarray:
        """(outputs, inputs) complex: the transfer function C (s - A)^-1 B + D at s, 1/s."""
        return self.C @ np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B) + self.D

    def only(self, inputs: Iterable[str] | None = None, outputs: Iterable[str] | None = None) -> StateSpace:
        """The same with these inputs and outputs, in this order; None: all of them.  Raises InputError for an unknown name."""
        columns = _places("input", self.inputs, inputs, self.scene)
        rows = _places("output", self.outputs, outputs, self.scene)
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[j] for j in columns),
            outputs=tuple(self.outputs[j] for j in rows),
        )

    def with_motions(self) -> StateSpace:
        """The same where an input whose rate is an input too is a state that the rate moves: what a rest length or a moved node
        does when it moves without jumps."""
        names = [quantity.name for quantity in self.inputs]
        rate = {j: names.index(name) for j, name in enumerate(map(_rate_of, names)) if name in names}
        moved, kept = list(rate), [j for j in range(len(names)) if j not in rate]
        n, k = len(self.A), len(moved)
        A, B = np.zeros((n + k, n + k)), np.zeros((n + k, len(kept)))
        A[:n, :n], A[:n, n:], B[:n] = self.A, self.B[:, moved], self.B[:, kept]
        for row, j in enumerate(moved, n):
            if rate[j] in moved:
                A[row, n + moved.index(rate[j])] = 1.0
            else:
                B[row, kept.index(rate[j])] = 1.0
        drift = np.append(self.drift, [self.inputs[rate[j]].value for j in moved])
        C, states = np.hstack([self.C, self.D[:, moved]]), (*self.states, *(self.inputs[j] for j in moved))
        inputs = tuple(self.inputs[j] for j in kept)
        return replace(self, A=A, B=B, C=C, D=self.D[:, kept], states=states, inputs=inputs, drift=drift)

    def to_scipy(self) -> Any:
        """scipy.signal.StateSpace of A, B, C and D; without inputs or outputs there is none: InputError."""
        from scipy import signal

        if not (self.inputs and self.outputs and self.states):
            raise InputError(f"{self.scene}: scipy's StateSpace needs a state, an input and an output; ask for some")
        return signal.StateSpace(self.A, self.B, self.C, self.D)

    def data(self) -> dict[str, Any]:
        """All of it, as JSON takes it."""
        found: dict[str, Any] = {"scene": self.scene, "strings": self.strings}
        for kind in ("states", "inputs", "outputs"):
            found[kind] = [quantity._asdict() for quantity in getattr(self, kind)]
        return found | {name: getattr(self, name).tolist() for name in ("A", "B", "C", "D", "drift")}

    def save(self, path: str | Path) -> Path:
        """Write it as .json, or as .mat: A, B, C, D, drift, and cells such as StateName, InputUnit, with values in OutputValue.

        Raises InputError where that cannot be written.
        """
        return write(self, path)

    def summary(self, count: int = 12) -> str:
        """A few lines: sizes, what it is about, the slowest poles."""
        lines = [f"{self.scene}: {len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"]
        special = [f"{name} {branch}" for name, branch in self.strings.items() if branch != "taut"]
        lines.append(f"  strings: {', '.join(special) or 'all of them'}{' and the others' if special else ''} taut")
        largest = float(np.abs(self.drift).max(initial=0.0))
        if largest > 1e-6:
            lines.append(f"  about a state that is not at rest: x' is up to {largest:.3g} there")
        poles = self.poles[self.poles.imag >= 0.0]
        poles = poles[np.lexsort((np.abs(poles), -poles.real))]
        lines += [f"  pole {p.real:z.6g}" + (f" +- {p.imag:.6g} i" if p.imag else "") + " /s" for p in poles[:count]]
        if len(poles) > count:
            lines.append(f"  and {len(poles) - count} that die out sooner")
        for kind in ("inputs", "outputs"):
            listed = [f"{q.name} [{q.unit}]" for q in getattr(self, kind)]
            lines.append(f"  {kind}: {', '.join(listed[:count])}{', ...' if len(listed) > count else ''}")
        return "\n".join(lines)


def write(system: StateSpace, path: str | Path) -> Path:
    """See `StateSpace.save`."""
    path = require_writable(path, (".json", ".mat"))
    if path.suffix.lower() == ".json":
        write_text(path, json.dumps(system.data(), indent=1) + "\n")
        return path
    from scipy import io

    arrays: dict[str, Any] = {name: getattr(system, name) for name in ("A", "B", "C", "D")}
    arrays |= {"drift": system.drift[:, None], "scene": system.scene}
    arrays |= {"StringName": _cells(system.strings), "StringBranch": _cells(system.strings.values())}
    for kind in ("State", "Input", "Output"):
        quantities = getattr(system, f"{kind.lower()}s")
        arrays[f"{kind}Name"] = _cells(quantity.name for quantity in quantities)
        arrays[f"{kind}Unit"] = _cells(quantity.unit for quantity in quantities)
        arrays[f"{kind}Value"] = np.array([[quantity.value] for quantity in quantities]).reshape(-1, 1)
    with replacing(path) as file:
        io.savemat(file, arrays)
    return path


def row_at(times: np.ndarray, time: float | None, run: str) -> int:
    """The row of a run at a time, s; None: the last.  Raises InputError where there is none within a millionth of a step."""
    if time is None:
        return len(times) - 1
    wanted = number("time", time)
    row = int(np.argmin(np.abs(times - wanted))) if np.isfinite(wanted) else 0
    if not abs(times[row] - wanted) <= 1e-6 * (np.diff(times).min(initial=np.inf) if len(times) > 1 else 1.0):
        raise InputError(f"time = {wanted:g} s is no row of {run}; the next one is at {times[row]:.10g} s: give that")
    return row


def require_tensions(system: StateSpace, model: Model, tension: np.ndarray, strings: Iterable[int]) -> None:
    """Raises InputError where a string pulls with another elastic tension than a run says, (S,) N: one with memory that is on
    another branch than one stretched from slack, or one whose rest length or law was another one."""
    values = {quantity.name: quantity.value for quantity in system.outputs}
    for j in strings:
        name, pulls = model.string_names[j], float(tension[j])
        found = values[f"{name}.elastic_force"]
        if abs(found - pulls) <= 1e-6 * max(1.0, abs(pulls)):
            continue
        if j in model.memories:
            raise InputError(
                f"{name} has memory and does not stand where it would be when stretched from slack; linearise about a run that "
                "ends on its first loading, or about a steady state"
            )
        raise InputError(
            f"{name} pulls with {pulls:.6g} N in the run, with {found:.6g} N as the scene has it: its rest length was another "
            "one; linearise the run itself: tc.linearize(run, time=...)"
        )


def _places(kind: str, known: Sequence[Quantity], wanted: Iterable[str] | None, scene: str) -> list[int]:
    names = [quantity.name for quantity in known]
    if wanted is None:
        return list(range(len(names)))
    wanted = [wanted] if isinstance(wanted, str) else list(wanted)
    for i, name in enumerate(wanted):
        if name not in names:
            raise InputError(f"{name} is no {kind} of {scene}; {nearest(str(name), names, f'{kind}s')}")
        if name in wanted[:i]:
            raise InputError(f"{name} is given twice among the {kind}s; give it once")
    return [names.index(name) for name in wanted]


def _rate_of(name: str) -> str:
    """The name of an input's rate; '' of one that has none."""
    for part, rate in RATES.items():
        if name.endswith(part) or (part.endswith(".") and part in name):
            return name.replace(part, rate)
    return ""


def _cells(texts: Iterable[str]) -> np.ndarray:
    """(n, 1) object: a cell array of texts."""
    listed = list(texts)
    found = np.empty((len(listed), 1), dtype=object)
    found[:, 0] = listed
    return found
