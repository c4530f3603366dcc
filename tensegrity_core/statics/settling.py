"""From any coordinates down to a stable equilibrium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import TensegrityError
from ..model import Model
from .balance import Balance
from .matrices import free_rows
from .strings import string_branches
from .surface import Surface, SurfacePoint

MAX_STEPS = 2500


class NoEquilibrium(TensegrityError):
    """The flow found no stable equilibrium."""


def settle(model: Model, force=None, rest_length=None, steps: int = 100, force_before=None) -> Model:
    """The steady state under constant forces (N, 3), N, and rest lengths (S,), m, reached from the model's start.

    force_before: (N, 3) N, the forces under which the model's start is meant to stand (none by default).  Forces and
    rest lengths go from there to their goal in equal steps.  After each, `descend` follows the overdamped gradient flow
    of the potential energy to its minimum.  Where the equilibrium stays stable this is continuation in the load; where
    it loses stability (a snap) the flow carries the structure over to the next minimum, as a slow load does with strong
    damping.  What it cannot say: a load that is applied at once, or a lightly damped structure, may overshoot into
    another basin; a snap's load is found to one load step; unstable branches are not traced.

    Strings with memory start as stretched from slack and carry their state along.  A model does not hold that state: its
    start is stretched from slack anew.

    Returns the model with its start moved there (external forces are not part of a model).
    Raises NoEquilibrium where the flow ends in no minimum, or in one that needs a state of a string with memory to which
    stretching it from slack does not lead.
    """
    goal = model.rest_length if rest_length is None else np.asarray(rest_length, dtype=float)
    none = np.zeros_like(model.nodes)
    first, last = (none if f is None else np.asarray(f, dtype=float) for f in (force_before, force))
    if np.array_equal(first, last) and np.array_equal(goal, model.rest_length):
        steps = 1
    free, laws = free_rows(model, model.nodes), string_branches(model, model.string_lengths(model.nodes))
    balance: Balance | None = None  # that of the first step: rest lengths make no difference to it
    for step in range(1, steps + 1):
        part = step / steps  # exactly 1 at the end
        loaded = replace(model, rest_length=(1.0 - part) * model.rest_length + part * goal)
        surface = Surface(loaded, (1.0 - part) * first + part * last, laws=laws, balance=balance)
        balance = surface.balance
        free = descend(surface, free, surface.balanced if step == steps else surface.nearly_balanced)
        laws = surface.laws
    nodes = model.nodes if balance is None else balance.nodes(free)
    settled, length = replace(model, nodes=nodes, rest_length=goal), model.string_lengths(nodes)
    anew = string_branches(settled, length)
    there = string_branches(settled, length, laws)
    for i in model.memories:
        if anew[i] != there[i]:
            count, others = (at[i].snapped_on_piece(0) for at in (there, anew))
            raise NoEquilibrium(
                f"string {model.string_names[i]} settles with {count} of its parts snapped, but stretching it "
                f"from slack leaves {others} so, and a start has no other memory"
            )
    return settled


def descend(surface: Surface, free: np.ndarray, tolerance: float) -> np.ndarray:
    """Follow the gradient flow to a minimum of the potential energy, from free coordinates (n,), m, to others.

    tolerance: N; a point where less is unbalanced counts as an equilibrium.  With the surface's own, `balanced`, the
    result is improved until round-off ends it.

    Each step solves the flow of the linearised force exactly (exponential Rosenbrock-Euler: Hochbruck and Ostermann,
    "Exponential integrators", 2010), so stiff directions need no small steps, unstable ones grow as they should, and
    a step without limit is Newton's.  No step moves a node by more than a small part of the structure.  At a saddle the
    flow goes on along the most unstable direction.
    """
    _require_support(surface)
    free = surface.moved(free, np.zeros(surface.size))
    best, found, stalled, pace = np.inf, free, 0, np.inf
    for _ in range(MAX_STEPS):
        point = surface.at(free)
        unbalanced = float(np.abs(point.pull).max(initial=0.0))
        stalled = 0 if unbalanced < 0.5 * best else stalled + 1
        if unbalanced < best:
            best, found = unbalanced, free
        if best <= tolerance and (stalled >= 2 or best == 0.0 or tolerance > surface.balanced):
            direction = _unstable_direction(point)
            if direction is None:
                return found
            free, best, stalled = surface.moved(found, 0.1 * surface.reach * direction), np.inf, 0
        else:
            free, pace = _flow_step(surface, free, point, pace)
        surface.keep(free)
    raise NoEquilibrium(
        f"no stable equilibrium was found: after {MAX_STEPS} steps, "
        f"{surface.gone(free):.3g} m away, {unbalanced:.3g} N are unbalanced"
    )


def _require_support(surface: Surface) -> None:
    """A structure afloat has an equilibrium only where its loads cancel, or press it to the ground."""
    model, net = surface.model, surface.load.sum(axis=0)
    afloat = np.logical_not(model.held[:, model.axes].any(axis=0))
    if model.contacts and model.ground is not None:
        normal = np.array(model.ground.normal)
        if net @ normal < 0.0:
            net = net - normal * (net @ normal)
        if np.abs(net[list(model.axes)][afloat]).max(initial=0.0) > surface.balanced:
            raise NoEquilibrium(
                f"no node is fixed, and the ground, here without friction, does not bear {np.linalg.norm(net):.6g} N of the "
                "loads; fix a node, or let it start released, where friction acts"
            )
        return
    net = net[list(model.axes)]
    if np.abs(net[afloat]).max(initial=0.0) > surface.balanced:
        raise NoEquilibrium(
            f"no node is fixed, and the loads' sum is not 0 but {np.linalg.norm(net):.6g} N; fix a node, or let it float "
            "without gravity (gravity = 0)"
        )


def _unstable_direction(point: SurfacePoint) -> np.ndarray | None:
    """(n,) unit vector of the most unstable direction, its largest component positive; None at a minimum."""
    if point.tangent.stable():
        return None
    direction = point.basis @ point.tangent.lowest()[1]
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def _flow_step(surface: Surface, free: np.ndarray, point: SurfacePoint, pace: float) -> tuple[np.ndarray, float]:
    """One step of the flow, as long as the surface and the energy allow, and the time that it took.

    pace: the time that the step before took; a step without limit is tried first, then times from not much more on.
    """
    time, slowest = np.inf, 1e9 / point.tangent.stiffest
    while True:
        way = point.tangent.way(point.pull, time, surface.balanced)
        step = None if way is None else point.basis @ way
        if step is not None and surface.near(free, step):
            trial = surface.moved(free, step)
            # far down, the energy's round-off hides its fall: the step is then below what the energy can resolve
            if surface.energy(trial) <= point.energy + surface.energy_round_off:
                return trial, time
        time = 0.25 * time if np.isfinite(time) else min(slowest, 8.0 * pace)
        if time < 1e-21 * slowest:
            return free if step is None else surface.moved(free, step), time
