"""Statics: prestress, equilibrium, its stability, and the model that starts there.

Members are numbered strings first, then bars.  A member's force is positive in tension.  Gravity acts as m g/2 at each
bar node.  Degrees of freedom are the free nodes' coordinates along the axes that the scene uses, node by node.

Equilibria are minima of the potential energy V(x) = strings + gravity - external forces over the positions that keep
every bar's length.  `descend` follows the overdamped gradient flow x' = -grad V on that surface, so it ends in the
minimum whose basin holds the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import nsh as nsh_law
from .errors import TensegrityError
from .model import NSH, Model

if TYPE_CHECKING:
    from .scene import Scene

RANK_TOLERANCE = 1e-9  # singular values below this part of the largest count as zero
BALANCED = 1e-10  # N: a start counts as balanced below this
MAX_STEPS = 2500
EPS = float(np.finfo(float).eps)


class NoEquilibrium(TensegrityError):
    """The flow found no stable equilibrium."""


# --- forces ------------------------------------------------------------------------------------------------------


def loads(model: Model, force=None) -> np.ndarray:
    """(N, 3) N: gravity on the bars' nodes plus external forces (N, 3)."""
    load = np.zeros((len(model.nodes), 3)) if force is None else np.array(force, dtype=float)
    np.add.at(load[:, 2], model.bars.ravel(), np.repeat(-0.5 * model.gravity * model.bar_mass, 2))
    return load


def string_tension(model: Model, length: np.ndarray) -> np.ndarray:
    """(S,) N: elastic tension of every string at these lengths (S,), m; a slack string carries nothing."""
    stretch = _stretch(model, length)
    return _with_nsh(model, model.stiffness * stretch, nsh_law.force, stretch)


def string_stiffness(model: Model, length: np.ndarray) -> np.ndarray:
    """(S,) N/m: derivative of the elastic tension by the length; 0 for a slack string."""
    stretch = _stretch(model, length)
    return _with_nsh(model, np.where(stretch > 0.0, model.stiffness, 0.0), nsh_law.stiffness, stretch)


def string_energy(model: Model, length: np.ndarray) -> np.ndarray:
    """(S,) J: energy stored in every string at these lengths (S,), m."""
    stretch = _stretch(model, length)
    return _with_nsh(model, 0.5 * model.stiffness * stretch**2, nsh_law.energy, stretch)


def _stretch(model: Model, length: np.ndarray) -> np.ndarray:
    return np.maximum(length - model.rest_length, 0.0)


def _with_nsh(model: Model, linear: np.ndarray, law, stretch: np.ndarray) -> np.ndarray:
    """The linear strings' values, with those of the NSH strings put in from `law`."""
    for i in model.nsh_strings:
        linear[i] = law(model.nsh[i], float(stretch[i]), float(model.stiffness[i]))
    return linear


def members(model: Model) -> np.ndarray:
    """(S+B, 2) nodes at the ends of all members, strings first."""
    return np.vstack([model.strings, model.bars])


def equilibrium_matrix(model: Model) -> np.ndarray:
    """(F*D, S+B): forces on the free nodes from a unit tension in each member, at the model's start.

    With member forces t and loads p (at the same rows) equilibrium reads A t + p = 0.  Pellegrino and Calladine,
    "Matrix analysis of statically and kinematically indeterminate frameworks", 1986.
    """
    ends = members(model)
    along = model.nodes[ends[:, 1]] - model.nodes[ends[:, 0]]
    unit = along / np.linalg.norm(along, axis=1)[:, None]
    matrix = np.zeros((len(model.nodes), 3, len(ends)))
    column = np.arange(len(ends))
    matrix[ends[:, 0], :, column] = unit
    matrix[ends[:, 1], :, column] = -unit
    return matrix[model.free_nodes][:, model.axes].reshape(-1, len(ends))


def member_forces(model: Model, force=None) -> np.ndarray:
    """(S+B,) N at the model's start: the strings' elastic tensions, then the bar forces that balance best."""
    string_force = string_tension(model, _lengths(model.nodes, model.strings))
    matrix, count = equilibrium_matrix(model), len(model.strings)
    rest = _rows(model, loads(model, force)) + matrix[:, :count] @ string_force
    bar_force = -_lstsq(matrix[:, count:], rest)
    return np.concatenate([string_force, bar_force])


def residual(model: Model, force=None) -> np.ndarray:
    """(F, D) N: unbalanced force on each free node at the model's start, bar forces chosen to balance best."""
    unbalanced = equilibrium_matrix(model) @ member_forces(model, force) + _rows(model, loads(model, force))
    return unbalanced.reshape(-1, len(model.axes))


def _rows(model: Model, field: np.ndarray) -> np.ndarray:
    """A nodal field (N, 3) at the rows of the equilibrium matrix."""
    return field[model.free_nodes][:, model.axes].ravel()


def _lengths(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)


def _lstsq(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(matrix, right, rcond=RANK_TOLERANCE)[0]


# --- rank, self-stress, mechanisms -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Analysis:
    """What the equilibrium matrix says about a structure.

    equations, members: its size, F*D and S+B; singular_values: of the matrix, falling; rank: of the matrix;
    self_stress: (S+B, s) orthonormal member forces that balance without load; mechanisms: (m, N, 3) orthonormal
    velocity fields that stretch no member, rigid-body motions taken out; rigid_body_motions: number of rigid-body
    motions that the fixed nodes leave.
    """

    equations: int
    members: int
    singular_values: np.ndarray
    rank: int
    self_stress: np.ndarray
    mechanisms: np.ndarray
    rigid_body_motions: int


def analyse(model: Model, tolerance: float = RANK_TOLERANCE) -> Analysis:
    """Rank, self-stress states and infinitesimal mechanisms at the model's start.

    tolerance: singular values below this part of the largest count as zero.
    """
    matrix = equilibrium_matrix(model)
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > tolerance * values[0])) if values.size else 0
    free = left[:, rank:]
    rigid = _rigid_body_motions(model)
    if rigid.shape[1]:
        projected = free - rigid @ (rigid.T @ free)
        directions, sizes, _ = np.linalg.svd(projected, full_matrices=False)
        free = directions[:, sizes > 0.5]  # the sizes are 0 (rigid) or 1 up to round-off
    fields = np.zeros((free.shape[1], len(model.nodes), 3))
    places = np.ix_(range(len(fields)), model.free_nodes, model.axes)
    fields[places] = free.T.reshape(-1, len(model.free_nodes), len(model.axes))
    return Analysis(*matrix.shape, values, rank, right[rank:].T, fields, rigid.shape[1])


def _rigid_body_motions(model: Model) -> np.ndarray:
    """(F*D, r) orthonormal rigid-body velocities of the free nodes that leave the fixed nodes at rest."""
    arm = model.nodes - model.nodes.mean(axis=0)
    arm = arm / max(1e-300, float(np.abs(arm).max()))
    fields = [np.tile(np.eye(3)[axis], (len(arm), 1)) for axis in model.axes]
    for axis in range(3):
        if len(model.axes) == 3 or axis not in model.axes:
            fields.append(np.cross(np.eye(3)[axis], arm))
    fields = np.array(fields)[:, :, model.axes]
    held = fields[:, model.fixed_nodes].reshape(len(fields), -1)
    combinations = _null_space(held.T)
    moving = fields[:, model.free_nodes].reshape(len(fields), -1).T @ combinations
    directions, sizes, _ = np.linalg.svd(moving, full_matrices=False)
    return directions[:, sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))]


def _null_space(matrix: np.ndarray) -> np.ndarray:
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix)
    return right[int(np.sum(values > RANK_TOLERANCE * max(values[0], 1e-300))) :].T


# --- from a scene to a model -------------------------------------------------------------------------------------


def build_model(scene: Scene) -> Model:
    """The scene's structure at its start, with the rest lengths that its prestress asks for.

    Raises SceneError where the prestress is undetermined, a string would have to push, a rest length would be
    negative, or no equilibrium exists.
    """
    model = _at_given_coordinates(scene)
    tension = _prestress(scene, model)
    model = replace(model, rest_length=_rest_lengths(scene, model, tension))
    if scene.start == "equilibrium":
        _require_balance(scene, model)
    if scene.start == "settled":
        try:
            model = settle(model)
        except NoEquilibrium as failure:
            remedy = 'Change the prestress or the coordinates, or write start = "released".'
            raise scene.error("start", str(failure), remedy, scene.start) from None
    return model


def _at_given_coordinates(scene: Scene) -> Model:
    index = {name: i for i, name in enumerate(scene.nodes)}
    nodes = np.array([scene.position(name) for name in scene.nodes])
    honeycombs = {name: NSH(entry.Q, entry.zeta, entry.h) for name, entry in scene.nsh.items()}
    return Model(
        name=scene.name,
        description=scene.description,
        axes=scene.axes,
        node_names=tuple(scene.nodes),
        bar_names=tuple(scene.bars),
        string_names=tuple(scene.strings),
        nodes=nodes,
        fixed=[name in scene.fixed for name in scene.nodes],
        bars=[[index[node] for node in bar.nodes] for bar in scene.bars.values()],
        bar_mass=[bar.mass for bar in scene.bars.values()],
        strings=[[index[node] for node in string.nodes] for string in scene.strings.values()],
        stiffness=[scene.stiffness(name) for name in scene.strings],
        damping=[scene.damping(name) for name in scene.strings],
        rest_length=np.zeros(len(scene.strings)),
        nsh=tuple(honeycombs.get(string.nsh) for string in scene.strings.values()),
        damping_law=scene.damping_law,
        gravity=scene.gravity,
        nominal=nodes,
    )


def _prestress(scene: Scene, model: Model) -> np.ndarray:
    """(S,) tensions at the given coordinates, N: those that the scene knows, and those that equilibrium adds."""
    tension = np.full(len(model.strings), np.nan)
    length = _lengths(model.nodes, model.strings)
    typed = [scene.prestress.rest_length.get(name, xi) for name, xi in zip(model.string_names, length)]
    held = string_tension(replace(model, rest_length=typed), length)
    for i, name in enumerate(model.string_names):
        if name in scene.prestress.tension:
            tension[i] = scene.prestress.tension[name]
        elif name in scene.prestress.rest_length:
            tension[i] = held[i]
    unknown = np.flatnonzero(np.isnan(tension))
    if not len(unknown):
        return tension
    if scene.start == "released":
        missing = model.string_names[unknown[0]]
        remedy = f"Give prestress.tension.{missing} or prestress.rest_length.{missing}."
        raise scene.error(f"strings.{missing}", "a released scene needs every string's tension", remedy)
    tension[unknown] = _balancing(scene, model, tension, unknown)
    return tension


def _balancing(scene: Scene, model: Model, tension: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """The unknown strings' tensions that balance the given coordinates (best, in the sense of least squares)."""
    matrix, count = equilibrium_matrix(model), len(model.strings)
    columns = np.concatenate([unknown, np.arange(count, matrix.shape[1])])
    free = _null_space(matrix[:, columns])[: len(unknown)]
    if free.shape[1]:
        open_strings = [model.string_names[i] for i, row in zip(unknown, free) if np.linalg.norm(row) > 1e-6]
        noun = "tension" if free.shape[1] == 1 else "tensions"
        problem = f"equilibrium leaves {free.shape[1]} {noun} undetermined"
        remedy = f"Give {free.shape[1]} more {noun} in prestress.tension, of: {', '.join(open_strings)}."
        raise scene.error("prestress", problem, remedy, scene.prestress.tension | scene.prestress.rest_length)
    known = np.concatenate([np.nan_to_num(tension), np.zeros(len(model.bars))])
    load = _rows(model, loads(model)) + matrix @ known
    found = -_lstsq(matrix[:, columns], load)[: len(unknown)]
    scale = max(1.0, float(np.abs(load).max(initial=0.0)))
    for i, value in zip(unknown, found):
        if value < -1e-9 * scale:
            name = model.string_names[i]
            problem = f"equilibrium at the given coordinates asks for a tension of {value:.6g} N, which no string has"
            remedy = "Change the prestress or the coordinates."
            raise scene.error(f"strings.{name}", problem, remedy)
    return np.maximum(found, 0.0)


def _rest_lengths(scene: Scene, model: Model, tension: np.ndarray) -> np.ndarray:
    """(S,) m: through k or the NSH's inverse; typed rest lengths stay as they are."""
    length = _lengths(model.nodes, model.strings)
    rest_length = np.zeros(len(tension))
    for i, name in enumerate(model.string_names):
        if name in scene.prestress.rest_length:
            rest_length[i] = scene.prestress.rest_length[name]
            continue
        k, law = float(model.stiffness[i]), model.nsh[i]
        pull = float(tension[i])
        stretch = pull / k if law is None else nsh_law.elongation(law, pull, k)
        rest_length[i] = length[i] - stretch
        if rest_length[i] < 0.0:
            key = f"prestress.tension.{name}" if name in scene.prestress.tension else f"strings.{name}"
            problem = f"a tension of {pull:.6g} N stretches the string by {stretch:.6g} m, more than its length"
            raise scene.error(key, problem, "Lower the tension or raise the stiffness.")
    return rest_length


def _require_balance(scene: Scene, model: Model) -> None:
    force = np.linalg.norm(residual(model), axis=1)
    if not len(force) or force.max() <= _round_off(model):
        return
    node = model.node_names[model.free_nodes[int(np.argmax(force))]]
    problem = f"the given coordinates are not in equilibrium: {force.max():.3g} N stay unbalanced at {node}"
    remedy = 'Correct the coordinates or the prestress, or write start = "settled" (or "released").'
    if not model.fixed.any() and model.gravity:
        remedy = "No node is fixed, so nothing bears the weight: fix a node, or let it float with gravity = 0."
    raise scene.error(f"nodes.{node}", problem, remedy)


def _round_off(model: Model) -> float:
    """N: what round-off in the coordinates can leave unbalanced; BALANCED unless members are very stiff or loaded."""
    length = _lengths(model.nodes, model.strings)
    forces = np.abs(member_forces(model))
    scale = float(np.max(model.stiffness * length, initial=0.0) + np.max(forces, initial=0.0))
    return max(BALANCED, 16.0 * EPS * scale)


# --- stability and settling --------------------------------------------------------------------------------------


class _Point(NamedTuple):
    """The structure at one configuration, along the directions that keep the bars' lengths.

    energy: V, J; basis: (F*D, r) orthonormal directions; pull: (r,) N, -grad V; values, vectors: eigenvalues, N/m, and
    eigenvectors (r, r) of the tangent stiffness there.
    """

    energy: float
    basis: np.ndarray
    pull: np.ndarray
    values: np.ndarray
    vectors: np.ndarray


class _Surface:
    """A model under constant loads, as a potential energy over the positions that keep the bars' lengths."""

    def __init__(self, model: Model, force):
        self.model, self.load = model, loads(model, force)
        self.bar_length = _lengths(model.nominal, model.bars)
        self.place = np.full((len(model.nodes), 3), -1)  # node, axis -> degree of freedom
        self.size = len(model.free_nodes) * len(model.axes)
        length = _lengths(model.nodes, model.strings)
        tension = string_tension(model, length)
        largest_force = float(np.max(tension, initial=0.0) + np.abs(self.load).max())
        stiffest = float(np.max(model.stiffness * length, initial=0.0))
        self.balanced = max(0.5 * BALANCED, 16.0 * EPS * (stiffest + largest_force))
        span = float(np.ptp(model.nodes, axis=0).max())
        self.nearly_balanced = max(self.balanced, 1e-6 * largest_force)
        self.energy_round_off = 16.0 * EPS * float(np.sum(tension * length) + np.abs(self.load).sum() * span)
        self.place[np.ix_(model.free_nodes, model.axes)] = np.arange(self.size).reshape(-1, len(model.axes))

    def energy(self, nodes: np.ndarray) -> float:
        stored = string_energy(self.model, _lengths(nodes, self.model.strings))
        return float(stored.sum() - np.sum(self.load * (nodes - self.model.nodes)))

    def at(self, nodes: np.ndarray) -> _Point:
        """Energy, force and tangent stiffness along the directions that keep the bars' lengths."""
        strings = self.model.strings
        along = nodes[strings[:, 1]] - nodes[strings[:, 0]]
        length = np.linalg.norm(along, axis=1)
        density = string_tension(self.model, length) / length
        total = self.load.copy()
        np.add.at(total, strings[:, 0], density[:, None] * along)
        np.add.at(total, strings[:, 1], -density[:, None] * along)
        force = _rows(self.model, total)
        normals = self._bar_normals(nodes)
        basis = np.linalg.qr(normals, mode="complete")[0][:, normals.shape[1] :]
        # bar force densities that balance best: the normals are orthogonal, as no two bars share a node
        bar_density = (normals.T @ force) / np.sum(normals**2, axis=0)
        tangent = basis.T @ self._stiffness(along, length, density, bar_density) @ basis
        values, vectors = np.linalg.eigh(0.5 * (tangent + tangent.T))
        return _Point(self.energy(nodes), basis, basis.T @ force, values, vectors)

    def moved(self, nodes: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Positions after a step (F*D,), bars brought back to their lengths: about the fixed end or the centre."""
        nodes = nodes.copy()
        nodes[np.ix_(self.model.free_nodes, self.model.axes)] += step.reshape(-1, len(self.model.axes))
        first, second = self.model.bars.T
        bar = nodes[second] - nodes[first]
        bar *= (self.bar_length / np.linalg.norm(bar, axis=1))[:, None]
        centre = 0.5 * (nodes[first] + nodes[second])
        fixed_first, fixed_second = self.model.fixed[first, None], self.model.fixed[second, None]
        at_first, at_second = nodes[first].copy(), nodes[second].copy()
        nodes[first] = np.where(fixed_first, at_first, np.where(fixed_second, at_second - bar, centre - 0.5 * bar))
        nodes[second] = np.where(fixed_second, at_second, np.where(fixed_first, at_first + bar, centre + 0.5 * bar))
        return nodes

    def _bar_normals(self, nodes: np.ndarray) -> np.ndarray:
        """(F*D, B): gradients of |b|^2/2 for every bar."""
        gradient = np.zeros((len(self.model.bars), len(nodes), 3))
        for i, (first, second) in enumerate(self.model.bars):
            gradient[i, second] = nodes[second] - nodes[first]
            gradient[i, first] = nodes[first] - nodes[second]
        return np.array([_rows(self.model, row) for row in gradient]).T

    def _stiffness(self, along, length, density, bar_density) -> np.ndarray:
        """(F*D, F*D) N/m: a string's block is k u u^T + density (1 - u u^T), a bar's density times 1."""
        model = self.model
        unit = along / length[:, None]
        material = string_stiffness(model, length) - density
        blocks = np.concatenate([density, bar_density])[:, None, None] * np.eye(3)
        blocks[: len(unit)] += material[:, None, None] * unit[:, :, None] * unit[:, None, :]
        total = np.zeros((self.size + 1, self.size + 1))  # the last row and column take the fixed nodes
        ends = self.place[members(model)]  # (S+B, 2, 3)
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            places = (ends[:, i, :, None], ends[:, j, None, :])
            np.add.at(total, places, blocks if i == j else -blocks)
        return total[:-1, :-1]


def tangent_stiffness(model: Model, force=None) -> np.ndarray:
    """Rising eigenvalues, N/m, of the tangent stiffness at the model's start, in the directions that keep the bars'
    lengths; negative: unstable; zero: neutral, as a rigid-body motion is."""
    return _Surface(model, force).at(model.nodes).values


def is_stable(values: np.ndarray) -> bool:
    """Whether no eigenvalue (r,), N/m, of a tangent stiffness is negative beyond round-off."""
    return bool(values.min(initial=0.0) >= -_neutral(values))


def settle(model: Model, force=None, rest_length=None, steps: int = 100, force_before=None) -> Model:
    """The steady state under constant forces (N, 3), N, and rest lengths (S,), m, reached from the model's start.

    force_before: (N, 3) N, the forces under which the model's start is meant to stand (none by default).  Forces and
    rest lengths go from there to their goal in equal steps.  After each, `descend` follows the overdamped gradient flow
    of the potential energy to its minimum.  Where the equilibrium stays stable this is continuation in the load; where
    it loses stability (a snap) the flow carries the structure over to the next minimum, as a slow load does with strong
    damping.  What it cannot say: a load that is applied at once, or a lightly damped structure, may overshoot into
    another basin; a snap's load is found to one load step; unstable branches are not traced.

    Returns the model with its start moved there (external forces are not part of a model).
    Raises NoEquilibrium where the flow ends in no minimum.
    """
    goal = model.rest_length if rest_length is None else np.asarray(rest_length, dtype=float)
    none = np.zeros_like(model.nodes)
    first, last = (none if f is None else np.asarray(f, dtype=float) for f in (force_before, force))
    if np.array_equal(first, last) and np.array_equal(goal, model.rest_length):
        steps = 1
    nodes = model.nodes
    for step in range(1, steps + 1):
        part = step / steps  # exactly 1 at the end
        loaded = replace(model, rest_length=(1.0 - part) * model.rest_length + part * goal)
        surface = _Surface(loaded, (1.0 - part) * first + part * last)
        nodes = descend(surface, nodes, surface.balanced if step == steps else surface.nearly_balanced)
    return replace(model, nodes=nodes, rest_length=goal)


def descend(surface: _Surface, nodes: np.ndarray, tolerance: float) -> np.ndarray:
    """Follow the gradient flow to a minimum of the potential energy; (N, 3) -> (N, 3), m.

    tolerance: N; a point where less is unbalanced counts as an equilibrium.  With the surface's own, `balanced`, the
    result is improved until round-off ends it.

    Each step solves the flow of the linearised force exactly (exponential Rosenbrock-Euler: Hochbruck and Ostermann,
    "Exponential integrators", 2010), so stiff directions need no small steps, unstable ones grow as they should, and
    a step without limit is Newton's.  No step moves a node by more than a small part of the structure.  At a saddle the
    flow goes on along the most unstable direction.
    """
    _require_support(surface)
    reach = _step_limit(surface.model)
    nodes = surface.moved(nodes, np.zeros(surface.size))
    best, found, stalled = np.inf, nodes, 0
    for _ in range(MAX_STEPS):
        point = surface.at(nodes)
        unbalanced = float(np.abs(point.pull).max(initial=0.0))
        stalled = 0 if unbalanced < 0.5 * best else stalled + 1
        if unbalanced < best:
            best, found = unbalanced, nodes
        if best <= tolerance and (stalled >= 2 or best == 0.0 or tolerance > surface.balanced):
            direction = _unstable_direction(point)
            if direction is None:
                return found
            nodes, best, stalled = surface.moved(found, 0.1 * reach * direction), np.inf, 0
        else:
            nodes = _flow_step(surface, nodes, point, reach)
    raise NoEquilibrium(
        f"no stable equilibrium was found: after {MAX_STEPS} steps, "
        f"{np.abs(nodes - surface.model.nodes).max():.3g} m away, {unbalanced:.3g} N are unbalanced"
    )


def _require_support(surface: _Surface) -> None:
    """A structure afloat has an equilibrium only where its loads cancel."""
    net = surface.load.sum(axis=0)[list(surface.model.axes)]
    if not surface.model.fixed.any() and np.abs(net).max() > surface.balanced:
        raise NoEquilibrium(
            f"no node is fixed, and the loads' sum is not 0 but {np.linalg.norm(net):.6g} N; fix a node, or let it float "
            "without gravity (gravity = 0)"
        )


def _step_limit(model: Model) -> float:
    """m: longest way of a node in one step: small beside the structure, and beside the beams of an NSH."""
    beams = [h for i in model.nsh_strings for h in model.nsh[i].h]
    return min([5e-3 * float(model.bar_length.min()), *(0.2 * h for h in beams)])


def _unstable_direction(point: _Point) -> np.ndarray | None:
    """(F*D,) unit vector of the most unstable direction, its largest component positive; None at a minimum."""
    if is_stable(point.values):
        return None
    direction = point.basis @ point.vectors[:, 0]
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def _neutral(values: np.ndarray) -> float:
    """N/m: eigenvalues nearer to 0 than this are round-off."""
    return 1e-10 * float(np.abs(values).max(initial=0.0))


def _flow_step(surface: _Surface, nodes: np.ndarray, point: _Point, reach: float) -> np.ndarray:
    """One step of the flow, as long as `reach` and the energy allow."""
    pull = point.vectors.T @ point.pull
    values = np.where(np.abs(point.values) < _neutral(point.values), 0.0, point.values)
    # a neutral direction without a force, such as a rigid-body motion, is left alone
    pull[(values == 0.0) & (np.abs(pull) <= surface.balanced)] = 0.0
    stiffest = float(np.abs(values).max(initial=0.0)) or 1.0
    endless = np.all((values > 0.0) | (pull == 0.0))
    time = np.inf if endless else 1e9 / stiffest
    while True:
        step = point.basis @ (point.vectors @ (_flow(values, time) * pull))
        if np.abs(step).max(initial=0.0) <= reach:
            trial = surface.moved(nodes, step)
            # far down, the energy's round-off hides its fall: the step is then below what the energy can resolve
            if surface.energy(trial) <= point.energy + surface.energy_round_off:
                return trial
        time = 0.25 * time if np.isfinite(time) else 1e9 / stiffest
        if time * stiffest < 1e-12:
            return surface.moved(nodes, step)


def _flow(values: np.ndarray, time: float) -> np.ndarray:
    """(1 - exp(-w t))/w for each eigenvalue w: the way that a unit force goes in the time t."""
    if np.isinf(time):
        return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0.0)
    way = np.full_like(values, time)
    growth = np.clip(-values * time, None, 600.0)  # no overflow: such a step is too long anyway
    return np.divide(-np.expm1(growth), values, out=way, where=values != 0.0)
