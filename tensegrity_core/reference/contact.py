"""The ground under nodes, as plain equations (section 10 of the theory).

A node is delta = h - n . (x - p) deep in the plane, h being the height of a ground that moves.  The ground presses with
N = k_n delta (1 + c delta'), or not at all where that is negative.  Friction is the force -k_t u of a bristle deflection u in
the plane, |k_t u| <= mu N: while it sticks u' = v_t, while it slips u' = v_t - gamma' t, t = u / |u|, with

    gamma' = t . v_t - (mu / k_t) N',   N' = k_n (delta' (1 + c delta') + c delta delta''),   so that |u| = mu N / k_t stays.

So only the direction of a slipping bristle is taken from the state.  At touch-down u = 0, and t is that of v_t, along which u
grows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from ..model import Model
from ..model.ground import CONTACT_MODES
from .equations import diagonal
from .moved import path

#: Deflection of a bristle, m, below which round-off and tolerances decide on its direction.
SHORT = 1e-10
APART, STICKING, SLIPPING, CLIPPED = range(len(CONTACT_MODES))


class Touching(NamedTuple):
    """The contacts at one instant.

    mode (K,): places in CONTACT_MODES; lift, lift_rate: h', m/s, and h'', m/s2, of the ground; depth, rate (K,): delta, m, and
    delta', m/s; slide (d, K): v_t along the plane's basis, m/s; pressure (K,): N before it is clipped, N; normal (K,): N;
    bristle (d, K): u, m; direction (d, K): t; friction (d, K): -k_t u, N.
    """

    mode: np.ndarray
    lift: float
    lift_rate: float
    depth: np.ndarray
    rate: np.ndarray
    slide: np.ndarray
    pressure: np.ndarray
    normal: np.ndarray
    bristle: np.ndarray
    direction: np.ndarray
    friction: np.ndarray


class Slipping(NamedTuple):
    """What follows once accelerations are known.

    depth_acceleration (K,): delta'', m/s2; slide_acceleration (d, K): m/s2; reach (K,): the rate of mu N / k_t, m/s;
    slip (K,): t . v_t - that rate, which is gamma' of what slips, m/s; bristle_rate (d, K): u', m/s.
    """

    depth_acceleration: np.ndarray
    slide_acceleration: np.ndarray
    reach: np.ndarray
    slip: np.ndarray
    bristle_rate: np.ndarray


class Contacts:
    """A model's contacts, once for all times.

    nodes, k, c, k_t, mu (K,): as in `model.Contact`; normal (3,); plane (3, d): orthonormal basis of the plane along the axes
    that the scene uses; select (K, n): 1 at each contact's node; limit (K,): mu / k_t, m/N; clips (K,): whether N could be
    negative and is clipped then.
    """

    def __init__(self, model: Model):
        table = model.contacts
        self.nodes = np.array([contact.node for contact in table], dtype=int)
        self.k, self.c, self.k_t, self.mu = (
            np.array([getattr(contact, name) for contact in table])
            for name in ("stiffness", "damping", "tangential_stiffness", "friction")
        )
        self.limit = self.mu / self.k_t
        self.clips = (self.c > 0.0) & (model.ground is not None and model.ground.law == "clipped")
        ground: Any = model.ground
        self.moving, self.point, self.normal = ground.moving, np.array(ground.point), np.array(ground.normal)
        axes = np.eye(3)[:, list(model.axes)]
        self.plane = axes @ scipy.linalg.null_space((self.normal @ axes)[None])
        self.select = np.eye(len(model.nodes))[self.nodes]

    def height(self, load, t: float):
        """Of the ground: h, m, h', m/s, h'', m/s2."""
        if not self.moving:
            return 0.0, 0.0, 0.0
        height, velocity = path(load.ground_height, load.ground_velocity, load.ground_acceleration, t - load.since)
        return height.item(), velocity.item(), load.ground_acceleration.item()

    def at(self, load, mode, t: float, N, Ndot, bristle) -> Touching:
        """The contacts in their modes (K,).  bristle (d, K): of the state."""
        height, lift, lift_rate = self.height(load, t)
        x, v = N[:, self.nodes], Ndot[:, self.nodes]
        depth = height - self.normal.dot(x - self.point[:, None])
        rate, slide = lift - self.normal.dot(v), self.plane.T.dot(v)
        pressure = self.k * depth * (1.0 + self.c * rate)
        normal = np.where((mode == STICKING) | (mode == SLIPPING), pressure, 0.0)
        direction = _unit(bristle, slide)
        u = np.where(mode == STICKING, bristle, np.where(mode == SLIPPING, self.limit * normal * direction, 0.0))
        return Touching(mode, lift, lift_rate, depth, rate, slide, pressure, normal, u, direction, -self.k_t * u)

    def forces(self, touching: Touching):
        """On all nodes (3, n), N."""
        return (self.normal[:, None] * touching.normal + self.plane.dot(touching.friction)).dot(self.select)

    def slipping(self, touching: Touching, Nddot) -> Slipping:
        """Nddot (3, n): under these contacts."""
        a = Nddot[:, self.nodes]
        depth_acceleration = touching.lift_rate - self.normal.dot(a)
        rate, mode = touching.rate, touching.mode
        reach = self.limit * self.k * (rate * (1.0 + self.c * rate) + self.c * touching.depth * depth_acceleration)
        slip = diagonal(touching.direction, touching.slide) - reach
        rubs = (mode == SLIPPING) & (self.mu > 0.0)
        moves = np.where(rubs, touching.slide - slip * touching.direction, 0.0)
        bristle_rate = np.where(mode == STICKING, touching.slide, moves)
        return Slipping(depth_acceleration, self.plane.T.dot(a), reach, slip, bristle_rate)

    def powers(self, touching: Touching, slipping: Slipping):
        """W: put in by the ground's motion (K,); lost in the ground's damping (K,), and by slip (K,)."""
        pressed = np.where(touching.mode == APART, 0.0, self.k * touching.depth)
        lost = (touching.normal - pressed) * touching.rate
        rubbed = np.where(touching.mode == SLIPPING, self.mu * touching.normal * slipping.slip, 0.0)
        return touching.normal * touching.lift, lost, rubbed

    def energy(self, touching: Touching) -> float:
        """J, in the ground and in bristles."""
        pressed = np.where(touching.mode == APART, 0.0, 0.5 * self.k * touching.depth**2)
        return float(np.sum(pressed) + np.sum(0.5 * self.k_t * diagonal(touching.bristle, touching.bristle)))

    def gaps(self, touching: Touching, slipping: Slipping) -> np.ndarray:
        """(3, K) how far each contact is from touching, or from leaving the ground (m); from being clipped or released
        (1 + c delta'); from slipping (m), or from sticking (m/s)."""
        mode = touching.mode
        found = np.full((3, len(mode)), np.inf)
        found[0] = np.where(mode == APART, -touching.depth, touching.depth)
        sign = np.where(mode == APART, np.inf, np.where(mode == CLIPPED, -1.0, 1.0))
        found[1] = np.where((mode == APART) | ~self.clips, np.inf, sign * (1.0 + self.c * touching.rate))
        sticks, slips = mode == STICKING, (mode == SLIPPING) & (self.mu > 0.0)
        size = np.sqrt(diagonal(touching.bristle, touching.bristle))
        found[2] = np.where(sticks, self.limit * touching.pressure - size, np.where(slips, slipping.slip, np.inf))
        return found

    def gap_rates(self, touching: Touching, slipping: Slipping) -> np.ndarray:
        """(3, K) the rates of the gaps, but for those of what slips: 0."""
        mode = touching.mode
        found = np.zeros((3, len(mode)))
        found[0] = np.where(mode == APART, -1.0, 1.0) * touching.rate
        found[1] = np.where(mode == CLIPPED, -1.0, 1.0) * self.c * slipping.depth_acceleration
        found[2] = np.where(mode == STICKING, -slipping.slip, 0.0)
        return found


def _unit(bristle, slide):
    """(d, K) u / |u|; where u is too short to say, that of v_t, from which u grows and to which it goes as it vanishes; where
    that is 0, too, 0."""
    found = np.where(np.any(np.abs(bristle) > SHORT, axis=0), bristle, slide)
    size = np.abs(found).max(axis=0, initial=0.0)
    found = found / np.where(size > 0.0, size, 1.0)  # so that no square vanishes
    return found / np.where(size > 0.0, np.sqrt(diagonal(found, found)), 1.0)
