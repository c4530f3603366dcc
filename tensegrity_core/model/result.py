"""What a simulation returns, whoever ran it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..fields import Field, outputs
from .ground import CONTACT_MODES
from .model import Model


@dataclass(frozen=True)
class Transition:
    """A string changed its piece: piece 0 is slack, 1.. the pieces of its force curve in order of elongation.

    A string with memory is on piece 1 plus the number of its snapped parts; loss: energy that a snap of it loses, J.
    Or a node's contact with the ground changed its mode, a place in `CONTACT_MODES`: contact is its place among the model's
    contacts then, and string is -1.
    """

    time: float
    string: int
    before: int
    after: int
    loss: float = 0.0
    contact: int = -1

    @property
    def kind(self) -> str:
        """Of a contact: touch_down, lift_off, clip, unclip, slip or stick; '' of a string."""
        if self.contact < 0:
            return ""
        before, after = CONTACT_MODES[self.before], CONTACT_MODES[self.after]
        if "apart" in (before, after):
            return "touch_down" if before == "apart" else "lift_off"
        if "clipped" in (before, after):
            return "clip" if after == "clipped" else "unclip"
        return {"slipping": "slip", "sticking": "stick"}[after]

    def name(self, model: Model) -> str:
        """Of its string, or of the node that touches the ground."""
        return model.string_names[self.string] if self.contact < 0 else model.node_names[model.contacts[self.contact].node]


class Result:
    """Series at the communication points times (K+1,), s.  Values are those at the end of the step that led there;
    row 0 is the start under the inputs of step 0.

    transitions: in order of time; stats: counters of the run; outputs: name -> series, each an attribute, too:

    """

    def __init__(
        self,
        times: np.ndarray,
        transitions: Iterable[Transition] = (),
        stats: dict[str, float] | None = None,
        **series: np.ndarray,
    ):
        """Raises ValueError where the series are not those of all outputs."""
        wanted, given = {field.name for field in outputs()}, set(series)
        if given != wanted:
            odd = [f"{name!r} is missing" for name in sorted(wanted - given)]
            odd += [f"{name!r} is none" for name in sorted(given - wanted)]
            raise ValueError(f"a result has a series for each output of fields.py: {', '.join(odd)}")
        self.times, self.transitions, self.stats = times, list(transitions), dict(stats or {})
        self.outputs = {field.name: series[field.name] for field in outputs()}

    def __getattr__(self, name: str) -> np.ndarray:
        if name != "outputs" and name in self.outputs:
            return self.outputs[name]
        raise AttributeError(f"a result has no series {name!r}; it has {', '.join(self.__dict__.get('outputs', ()))}")

    def __dir__(self):
        return [*super().__dir__(), *self.outputs]

    def ledger_error(self) -> float:
        """Largest gap in the energy ledger over the run, relative to max(1 J, integral of the sum of |power|)."""
        balance = self.kinetic + self.potential + self.elastic + self.dissipated - self.input_work
        return float(np.max(np.abs(balance - balance[0])) / max(1.0, float(self.throughput[-1])))


def _line(field: Field) -> str:
    """A series in one line of the docstring: name, shape, unit, meaning."""
    shape = (
        f"(K+1, {'K' if 'K' in field.shape else 'N'}, 3)"
        if field.shape[-1:] == ("D",)
        else f"(K+1, {field.shape[0]})"
        if field.shape
        else "(K+1,)"
    )
    return f"    {field.name}: {shape} {field.unit}; {field.meaning}"


Result.__doc__ = (
    str(Result.__doc__).rstrip()
    + "\n\n"
    + "\n".join(map(_line, outputs()))
    + """

    Vectors are zero at nodes that a series does not count: velocities at fixed nodes, moved or not, reactions at free ones.
    """
)
