"""Small models on the ground, made without a scene file: for the tests of contact."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tensegrity_core.model import Contact, Ground, Model, Result

#: m/s2
GRAVITY = 9.81
#: Of the ground, N/m.
STIFFNESS = 2e4


def _model(nodes, bars, velocity, contact, planar, gravity, point_mass) -> Model:
    nodes, none = np.array(nodes, dtype=float), np.zeros((0, 2), dtype=int)
    return Model(
        name="touching",
        description="",
        axes=(0, 2) if planar else (0, 1, 2),
        node_names=tuple(f"n{i + 1}" for i in range(len(nodes))),
        bar_names=tuple(f"b{i + 1}" for i in range(len(bars))),
        string_names=(),
        nodes=nodes,
        fixed=np.zeros(len(nodes), dtype=bool),
        bars=np.array(bars, dtype=int).reshape(-1, 2),
        bar_mass=np.ones(len(bars)),
        strings=none,
        stiffness=np.zeros(0),
        damping=np.zeros(0),
        rest_length=np.zeros(0),
        nsh=(),
        damping_law="literal",
        gravity=gravity,
        nominal=nodes,
        velocity=np.array(velocity, dtype=float),
        point_mass=point_mass,
        ground=Ground(),
        contacts=tuple(Contact(n, *contact) for n in range(len(nodes))),
    )


def mass(position, velocity=(0.0, 0.0, 0.0), c=0.0, mu=0.0, kt=STIFFNESS, planar=False, gravity=GRAVITY) -> Model:
    """A point mass of 1 kg."""
    return _model([position], [], [velocity], (STIFFNESS, c, kt, mu), planar, gravity, ((0, 1.0),))


def rod(one, other, v_one=(0.0, 0.0, 0.0), v_other=(0.0, 0.0, 0.0), c=0.0, mu=0.0, kt=STIFFNESS, planar=False, gravity=GRAVITY):
    """A bar of 1 kg that may touch the ground with both ends."""
    return _model([one, other], [[0, 1]], [v_one, v_other], (STIFFNESS, c, kt, mu), planar, gravity, ())


def lying(speed=0.0, mu=0.0, slope=0.0, **others) -> Model:
    """A bar of 1 m along x that presses the ground as its weight does, bristles at rest, on an incline: gravity is turned."""
    depth = GRAVITY * math.cos(slope) / 2.0 / STIFFNESS
    down = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
    speeds = (speed, 0.0, 0.0)
    return rod((0.0, 0.0, -depth), (1.0, 0.0, -depth), speeds, speeds, mu=mu, gravity=down, **others)


def thrown(**others) -> Model:
    """A spinning bar, thrown at the ground aslant."""
    return rod((-0.5, 0.0, 0.2), (0.5, 0.0, 0.3), (0.5, -4.0, 0.0), (0.5, 4.0, 0.0), mu=0.4, c=0.2, **others)


def moving(model: Model) -> Model:
    """The same on a ground whose height is an input."""
    return dataclasses.replace(model, ground=dataclasses.replace(model.ground, moving=True))


def ledger(result: Result) -> float:
    """Largest error of the energy ledger, relative to the energy that has passed (with a floor of 1 J)."""
    total = result.kinetic + result.potential + result.elastic + result.dissipated - result.input_work
    return float(np.abs(total - total[0]).max() / max(1.0, result.throughput[-1]))
