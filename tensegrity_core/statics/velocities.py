"""Start velocities, as far as bars and welds let nodes move."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model import Model
from ..model.joints import length_rows
from .matrices import lstsq, null_space

if TYPE_CHECKING:
    from ..scene import Scene

#: Part of the fastest node's speed at which a bar may seem to change its length: velocities are typed in so many digits.
ROUNDED = 1e-6
#: Bars that a message lists.
MOST_LISTED = 6


def start_velocities(scene: Scene, model: Model) -> np.ndarray:
    """(N, 3) m/s, as the scene gives them.

    Raises SceneError where bars would change their lengths, or welded ones bend; what is less than ROUNDED is left to the
    simulation, which puts velocities on the lengths.
    """
    velocity = np.zeros_like(model.nodes)
    for name, given in scene.velocities.items():
        velocity[model.node_names.index(name)] = scene.vector(given)
    fastest = float(np.linalg.norm(velocity, axis=1).max())
    rates = stretching(model, velocity)
    wrong = np.flatnonzero(np.abs(rates) > ROUNDED * fastest)
    if len(wrong):
        worst = wrong[np.argsort(-np.abs(rates[wrong]))]
        listed = ", ".join(f"{model.bar_names[i]} by {rates[i]:.4g} m/s" for i in worst[:MOST_LISTED])
        more = f" and {len(worst) - MOST_LISTED} more" if len(worst) > MOST_LISTED else ""
        ends = [model.node_names[node] for node in model.bars[worst[0]]]
        problem = f"lengthens bars, which are rigid: {listed}{more}"
        remedy = f"Let {ends[0]} and {ends[1]} have the same velocity along bar {model.bar_names[worst[0]]}."
        raise scene.error(_key(scene, ends), problem, remedy)
    _require_room(scene, model, velocity, fastest)
    for body in model.bodies:
        bent = _bending(model.nodes[list(body.nodes)], velocity[list(body.nodes)])
        if bent > ROUNDED * fastest:
            names = ", ".join(model.bar_names[i] for i in body.bars)
            problem = f"bends the welded bars {names} at {bent:.4g} m/s"
            ends = [model.node_names[node] for node in body.nodes]
            raise scene.error(_key(scene, ends), problem, "Let the body move and turn as a whole.")
    return velocity


def _require_room(scene: Scene, model: Model, velocity: np.ndarray, fastest: float) -> None:
    """Raises SceneError where redundant bars keep their lengths to first order only.

    Their second derivatives vanish, too, where b . b'' = -|b'|^2 for all bars; the sum of q b . b'' is 0 for every state of
    self-stress (force densities q), whatever the accelerations, so that of q |b'|^2 has to be.
    """
    bars = np.flatnonzero(model.redundant)
    if not len(bars):
        return
    rates = (velocity[model.bars[:, 1]] - velocity[model.bars[:, 0]])[bars]
    squares = np.sum(rates * rates, axis=1)
    states = null_space(length_rows(model, bars).T) / model.bar_length[bars][:, None]
    states /= np.abs(states).max(axis=0, initial=1e-300)
    if np.abs(states.T @ squares).max(initial=0.0) > ROUNDED * fastest**2:
        moved = [model.bar_names[i] for i, square in zip(bars, squares) if square > ROUNDED * fastest**2]
        ends = [model.node_names[node] for i in bars for node in model.bars[i]]
        problem = (
            f"moves bars that hold each other, {', '.join(moved[:MOST_LISTED])}, so that they cannot all keep their lengths"
        )
        raise scene.error(_key(scene, ends), problem, "Leave out what bends them, or one of the bars.")


def stretching(model: Model, velocity: np.ndarray) -> np.ndarray:
    """(B,) m/s at which velocities (N, 3) lengthen the bars."""
    vectors, rates = (values[model.bars[:, 1]] - values[model.bars[:, 0]] for values in (model.nodes, velocity))
    return np.sum(vectors * rates, axis=1) / np.linalg.norm(vectors, axis=1)


def _bending(x: np.ndarray, velocity: np.ndarray) -> float:
    """m/s: how far velocities (k, 3) of points x (k, 3) are from those of a rigid body."""
    arm = x - x.mean(axis=0)
    motions = [np.tile(axis, (len(x), 1)) for axis in np.eye(3)] + [np.cross(axis, arm) for axis in np.eye(3)]
    fields = np.array([motion.ravel() for motion in motions]).T
    left = velocity.ravel() - fields @ lstsq(fields, velocity.ravel())
    return float(np.linalg.norm(left.reshape(-1, 3), axis=1).max())


def _key(scene: Scene, nodes: list[str]) -> str:
    return next((f"velocities.{node}" for node in nodes if node in scene.velocities), "velocities")
