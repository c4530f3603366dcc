"""Random structures with joints: the reference's accelerations against a multiplier formulation whose constraints are
differentiated by differences; class-1 scenes by the article's equations and by those of joints; ledgers and lengths."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tensegrity_core import reference
from tensegrity_core.model import Inputs, Model, grid
from tensegrity_core.reference import instant
from tensegrity_core.reference.structure import Structure
from tests.kernel.test_random_scenes import random_inputs, random_model
from tests.support.driven_scenes import LABORATORY, built
from tests.support.jointed_scenes import random_forces, random_joints

NO_STRINGS = dict.fromkeys(("string_names", "strings", "stiffness", "damping", "rest_length", "nsh", "element"), ())
NO_STRINGS |= {"damper": (), "actuator": (), "current": (), "drum_load": ()}


def constraints(model: Model, x: np.ndarray) -> np.ndarray:
    """Half squares of what bars and welds keep, m2: the bars' lengths and all distances within a body."""
    pairs = [tuple(ends) for ends in model.bars.tolist()]
    for body in model.bodies:
        pairs += [(i, j) for i in body.nodes for j in body.nodes if i < j and (i, j) not in pairs and (j, i) not in pairs]
    return np.array([0.5 * np.sum((x[j] - x[i]) ** 2) for i, j in pairs])


def multipliers(model: Model, x: np.ndarray, v: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(N, 3) accelerations under forces F (N, 3) by one dense system, mass by mass and pair by pair."""
    free = (~model.held & np.isin(np.arange(3), model.axes)).ravel()
    M = np.zeros((3 * len(x), 3 * len(x)))
    for (i, j), m in zip(model.bars.tolist(), model.bar_mass.tolist()):
        for a in range(3):
            M[np.ix_([3 * i + a, 3 * j + a], [3 * i + a, 3 * j + a])] += m / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    for node, m in model.point_mass:
        M[range(3 * node, 3 * node + 3), range(3 * node, 3 * node + 3)] += m
    step, flat = 1e-4, x.ravel()
    moves = step * np.eye(flat.size)[free]
    G = np.array(
        [constraints(model, (flat + d).reshape(x.shape)) - constraints(model, (flat - d).reshape(x.shape)) for d in moves]
    )
    G = G.T / (2.0 * step)
    ahead, behind = (constraints(model, x + sign * 1e-3 * v) for sign in (1.0, -1.0))
    curved = (ahead + behind - 2.0 * constraints(model, x)) / 1e-6  # exact but for round-off: the constraints are quadratic
    whole = np.block([[M[np.ix_(free, free)], -G.T], [G, np.zeros((len(G), len(G)))]])
    right = np.concatenate((F.ravel()[free], -curved))
    found = np.zeros(flat.size)
    found[free] = np.linalg.lstsq(whole, right, rcond=1e-9)[0][: free.sum()]
    return found.reshape(x.shape)


@pytest.mark.parametrize("seed", range(40))
def test_accelerations(seed):
    """At the start, turning where the structure is afloat, under random forces at its nodes.  No body of these structures is
    flatter than its scene and has more nodes than span it; only distances hold them."""
    model = dataclasses.replace(random_joints(seed), drag=(), **NO_STRINGS)
    assert not any(body.followers for body in model.bodies)
    s = Structure(model)
    F = np.random.default_rng(seed).normal(scale=10.0, size=model.nodes.shape) * np.isin(np.arange(3), model.axes)
    inputs = Inputs(grid(0.1, 0.1), F[None] * ~model.fixed[None, :, None]).resolved(model)
    none = np.zeros(0, dtype=int)
    motion = instant.motion_at(
        s, instant.load_of(s, inputs, 0), instant.mode_of(s, none, none > 0), 0.0, model.nodes.T, model.velocity.T
    )
    expected = multipliers(model, model.nodes, model.velocity, F + s.weight.T)
    assert np.abs(motion.Nddot.T - expected).max() < 1e-5 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_ledger_and_lengths(seed):
    model = random_joints(seed)
    result = reference.simulate(model, random_forces(model, seed))
    assert result.ledger_error() < 1e-8
    place = result.position
    lengths = np.linalg.norm(place[:, model.bars[:, 1]] - place[:, model.bars[:, 0]], axis=2)
    np.testing.assert_allclose(lengths, np.tile(model.bar_length, (len(place), 1)), rtol=1e-13)
    for body in model.bodies:
        apart = place[:, body.nodes][:, :, None] - place[:, body.nodes][:, None]
        assert np.ptp(np.linalg.norm(apart, axis=3), axis=0).max() < 1e-13


def as_joined(model: Model) -> Model:
    """The same model, to be simulated by the equations of joints."""
    other = dataclasses.replace(model)
    other.__dict__["joint"] = "said to be beyond class 1"
    return other


def shaken_laboratory():
    """A class-1 scene with everything, whose moved pins jump in position and velocity at every communication point."""
    model, random = built(LABORATORY), np.random.default_rng(0)
    shape = (10, len(model.moving), 3)
    place = model.nodes[list(model.moving)] + random.normal(scale=0.01, size=shape)
    place[0] = model.nodes[list(model.moving)]
    motion = {"node_position": place, "node_velocity": random.normal(scale=0.3, size=shape)}
    motion |= {"node_acceleration": random.normal(scale=2.0, size=shape)}
    force = random.normal(scale=10.0, size=(10, len(model.nodes), 3))
    return model, Inputs(grid(0.5, 0.05), force=force, **motion).resolved(model)


@pytest.mark.parametrize("seed", [None, *range(6)])
def test_class_1_by_either_equations(seed):
    """The article's, and those of joints, which share no more than the mass matrix."""
    model, inputs = shaken_laboratory() if seed is None else (random_model(seed), None)
    inputs = random_inputs(model, seed) if inputs is None else inputs
    ours, theirs = reference.simulate(as_joined(model), inputs), reference.simulate(model, inputs)
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0.0, atol=1e-11)
    scale = 1e-5 * (1.0 + np.abs(theirs.string_force).max())
    np.testing.assert_allclose(ours.bar_force, theirs.bar_force, rtol=0.0, atol=scale)
    np.testing.assert_allclose(ours.reaction, theirs.reaction, rtol=0.0, atol=scale)
    assert ours.ledger_error() < 1e-8
