"""The ground: a plane that some nodes cannot pass but for a small elastic penetration, with friction that sticks.

With the penetration delta >= 0 of a node it presses with N = k_n delta (1 + c delta'), never less than 0.  Friction is elastic
and perfectly plastic: a bristle deflection u in the plane, the force -k_t u, |k_t u| <= mu N.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import array_of, number

#: What a touching node does, in the order of its numbers in transitions: where the ground presses, it sticks or slips; where it
#: would have to pull, it is clipped.
CONTACT_MODES = ("apart", "sticking", "slipping", "clipped")


@dataclass(frozen=True)
class Ground:
    """point: of the plane, m; normal: unit vector out of the ground; moving: whether its height along the normal, from the
    point, is an input; law: 'clipped', or 'literal', where N may be negative and there is no friction."""

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    moving: bool = False
    law: str = "clipped"

    def __post_init__(self):
        for name in ("point", "normal"):
            object.__setattr__(self, name, tuple(array_of(f"ground.{name}", getattr(self, name), (3,)).tolist()))
        object.__setattr__(self, "moving", bool(self.moving))


@dataclass(frozen=True)
class Contact:
    """A node that may touch the ground.

    stiffness: k_n, N/m; damping: c, s/m; tangential_stiffness: k_t, N/m; friction: mu, 1.
    """

    node: int
    stiffness: float
    damping: float
    tangential_stiffness: float
    friction: float

    def __post_init__(self):
        object.__setattr__(self, "node", int(self.node))
        for name in ("stiffness", "damping", "tangential_stiffness", "friction"):
            object.__setattr__(self, name, number(f"contact.{name}", getattr(self, name)))
