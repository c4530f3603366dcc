"""Statics: prestress, equilibrium, its stability, and the model that starts there.

Members are numbered strings first, then bars.  A member's force is positive in tension.  Gravity acts as m g/2 at each
bar node, and on point masses.  Degrees of freedom are the free nodes' coordinates along the axes that the scene uses,
node by node.  Actuators hold their strings' rest lengths.

Equilibria are minima of the potential energy V(x) = strings + gravity - external forces over the positions that keep
every bar's length.  `descend` follows the overdamped gradient flow x' = -grad V on that surface, so it ends in the
minimum whose basin holds the start.

Forces, equilibrium and settling cost time and memory in proportion to the structure: matrices are sparse beyond SMALL.
What needs all singular values or eigenvalues is for structures up to WHOLE.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from . import hysteresis
from . import laws
from . import nsh as nsh_law
from . import simulable
from .errors import InputError, TensegrityError
from .model import NSH, Actuator, Model

if TYPE_CHECKING:
    from .scene import Scene

RANK_TOLERANCE = 1e-9  # singular values below this part of the largest count as zero
BALANCED = 1e-10  # N: a start counts as balanced below this
MAX_STEPS = 2500
SMALL = 300  # degrees of freedom up to which settling works with dense matrices and all eigenvectors
WHOLE = 2000  # degrees of freedom, or members, up to which singular values and eigenvalues are computed
NEUTRAL = 1e-10  # eigenvalues below this part of the largest are round-off
EPS = float(np.finfo(float).eps)


class NoEquilibrium(TensegrityError):
    """The flow found no stable equilibrium."""


class TooLarge(TensegrityError):
    """An analysis by dense matrices was asked for a structure beyond WHOLE."""


# --- forces ------------------------------------------------------------------------------------------------------


def loads(model: Model, force=None) -> np.ndarray:
    """(N, 3) N: gravity on bars and point masses, at the nodes, plus external forces (N, 3)."""
    load = np.zeros((len(model.nodes), 3)) if force is None else np.array(force, dtype=float)
    return load + model.node_mass[:, None] * model.g


#: Per string with memory the branch that it is on.
Branches = dict[int, hysteresis.Branch]


def string_tension(model: Model, length: np.ndarray, branches: Branches | None = None) -> np.ndarray:
    """(S,) N: elastic tension of every string at these lengths (S,), m; a slack string carries nothing.

    branches: where strings with memory come from, on a continuous way; without, they are stretched from slack.
    """
    stretch = _stretch(model, length)
    return _with_laws(model, model.stiffness * stretch, "force", stretch, branches)


def string_stiffness(model: Model, length: np.ndarray, branches: Branches | None = None) -> np.ndarray:
    """(S,) N/m: derivative of the elastic tension by the length; 0 for a slack string."""
    stretch = _stretch(model, length)
    return _with_laws(model, np.where(stretch > 0.0, model.stiffness, 0.0), "stiffness", stretch, branches)


def string_energy(model: Model, length: np.ndarray, branches: Branches | None = None) -> np.ndarray:
    """(S,) J: energy stored in every string at these lengths (S,), m."""
    stretch = _stretch(model, length)
    return _with_laws(model, 0.5 * model.stiffness * stretch**2, "energy", stretch, branches)


def string_branches(model: Model, length: np.ndarray, branches: Branches | None = None) -> Branches:
    """The branches of the strings with memory at these lengths (S,), m; for `branches` see `string_tension`."""
    return _branches(model, length - model.rest_length, branches)


def _branches(model: Model, stretch: np.ndarray, before: Branches | None) -> Branches:
    if before is None:
        before = {i: hysteresis.start(element, float(model.stiffness[i])) for i, element in model.memories.items()}
    return {i: hysteresis.follow(branch, float(stretch[i]))[0] for i, branch in before.items()}


def string_elongation(model: Model, i: int, force: float) -> float:
    """Smallest elongation at which string i bears the force (N), m, stretched from slack."""
    k = float(model.stiffness[i])
    if i in model.memories:
        return hysteresis.elongation(model.memories[i], k, force)
    if i in model.laws:
        return laws.law(model.laws[i]).elongation(force, k)
    return force / k if model.nsh[i] is None else nsh_law.elongation(model.nsh[i], force, k)


def _stretch(model: Model, length: np.ndarray) -> np.ndarray:
    return np.maximum(length - model.rest_length, 0.0)


def _with_laws(model: Model, linear: np.ndarray, what: str, stretch: np.ndarray, branches: Branches | None) -> np.ndarray:
    """The linear strings' values, with `what` (force, stiffness or energy) of all others put in."""
    for i in model.plain_nsh_strings:
        linear[i] = getattr(nsh_law, what)(model.nsh[i], float(stretch[i]), float(model.stiffness[i]))
    for i, element in model.laws.items():
        linear[i] = getattr(laws.law(element), what)(float(stretch[i]), float(model.stiffness[i]))
    for i, branch in _branches(model, stretch, branches).items():
        linear[i] = getattr(branch, what)(float(stretch[i]))
    return linear


def members(model: Model) -> np.ndarray:
    """(S+B, 2) nodes at the ends of all members, strings first."""
    return np.vstack([model.strings, model.bars])


def equilibrium_matrix(model: Model) -> np.ndarray:
    """(F*D, S+B): forces on the free nodes from a unit tension in each member, at the model's start.

    With member forces t and loads p (at the same rows) equilibrium reads A t + p = 0.  Pellegrino and Calladine,
    "Matrix analysis of statically and kinematically indeterminate frameworks", 1986.
    Raises TooLarge: the matrix is dense.
    """
    _require_small(model, "the equilibrium matrix")
    found = _equilibrium(model)
    matrix = np.zeros((_freedoms(model), len(model.strings) + len(model.bars)), order="F")
    matrix[found.rows, found.columns] += found.values  # adds, so that no zero has a sign
    return matrix


class _Entries(NamedTuple):
    """The equilibrium matrix by its entries, column by column; rows, columns, values: (E,); size: of rows, F*D.

    Products with it need no package of sparse matrices, whose import takes longer than they do.
    """

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    size: int

    def forces(self, tension: np.ndarray) -> np.ndarray:
        """(F*D,) N: what members pull on the free nodes."""
        return np.bincount(self.rows, self.values * tension[self.columns], self.size)

    def along(self, field: np.ndarray, count: int) -> np.ndarray:
        """(S+B,): a field (F*D,) on each of `count` members."""
        return np.bincount(self.columns, self.values * field[self.rows], count)

    def squares(self, count: int) -> np.ndarray:
        """(S+B,): the columns' squared lengths, of `count` members."""
        return np.bincount(self.columns, self.values**2, count)


def _equilibrium(model: Model) -> _Entries:
    """The equilibrium matrix, sparse."""
    ends, place = members(model), places(model)
    along = model.nodes[ends[:, 1]] - model.nodes[ends[:, 0]]
    unit = (along / np.linalg.norm(along, axis=1)[:, None])[:, model.axes]
    rows = np.stack([place[ends[:, 0]], place[ends[:, 1]]]).ravel()
    columns = np.broadcast_to(np.arange(len(ends))[:, None], (2, *unit.shape)).ravel()
    order = np.lexsort((rows, columns))
    order = order[rows[order] >= 0]
    return _Entries(rows[order], columns[order], np.stack([unit, -unit]).ravel()[order], _freedoms(model))


def places(model: Model) -> np.ndarray:
    """(N, D) int: the degree of freedom of each node along each axis, -1 where it is fixed."""
    place = np.full((len(model.nodes), len(model.axes)), -1)
    place[model.free_nodes] = np.arange(_freedoms(model)).reshape(-1, len(model.axes))
    return place


def _freedoms(model: Model) -> int:
    return len(model.free_nodes) * len(model.axes)


def _dense(rows, columns, values, shape: tuple[int, int]) -> np.ndarray:
    """Sum of values at these places (arrays that broadcast); those in row or column -1 are left out."""
    matrix = np.zeros((shape[0] + 1, shape[1] + 1))  # the last row and column take them
    np.add.at(matrix, (rows, columns), values)
    return matrix[:-1, :-1]


def _sparse(rows, columns, values, shape: tuple[int, int]) -> scipy.sparse.csc_array:
    """The same as a sparse matrix."""
    rows, columns, values = (array.ravel() for array in np.broadcast_arrays(rows, columns, values))
    kept = (rows >= 0) & (columns >= 0)
    return scipy.sparse.coo_array((values[kept], (rows[kept], columns[kept])), shape).tocsc()


def _require_small(model: Model, what: str) -> None:
    size = max(_freedoms(model), len(model.strings) + len(model.bars))
    if size > WHOLE:
        most = f"structures of up to {WHOLE} degrees of freedom and members"
        raise TooLarge(f"{model.name}: {what} is for {most}; here are {size}")


def member_forces(model: Model, force=None) -> np.ndarray:
    """(S+B,) N at the model's start: the strings' elastic tensions, then the bar forces that balance best."""
    string_force = string_tension(model, _lengths(model.nodes, model.strings))
    matrix, count, bars = _equilibrium(model), len(model.strings), len(model.bars)
    rest = _rows(model, loads(model, force)) + matrix.forces(np.concatenate([string_force, np.zeros(bars)]))
    # least squares, bar by bar: their columns are orthogonal, as no two bars share a node
    bar_force = -matrix.along(rest, count + bars) / np.maximum(matrix.squares(count + bars), 1e-300)
    return np.concatenate([string_force, bar_force[count:]])


def residual(model: Model, force=None) -> np.ndarray:
    """(F, D) N: unbalanced force on each free node at the model's start, bar forces chosen to balance best."""
    unbalanced = _equilibrium(model).forces(member_forces(model, force)) + _rows(model, loads(model, force))
    return unbalanced.reshape(-1, len(model.axes))


class Unbalanced(NamedTuple):
    """force: N, the largest unbalanced force on a free node at the start; node: its number, -1 where no node is free;
    equilibrium: whether it is round-off."""

    force: float
    node: int
    equilibrium: bool


def unbalanced(model: Model, force=None) -> Unbalanced:
    """Whether the model's start is an equilibrium under external forces (N, 3), N, and how far it is from one."""
    size = np.linalg.norm(residual(model, force), axis=1)
    if not len(size):
        return Unbalanced(0.0, -1, True)
    worst, largest = int(np.argmax(size)), np.abs(member_forces(model, force)).max(initial=0.0)
    small = max(10.0 * _round_off(model), 1e-9 * float(largest))
    return Unbalanced(float(size[worst]), int(model.free_nodes[worst]), bool(size[worst] <= small))


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
    Raises TooLarge: time grows with the third power of the structure.
    """
    _require_small(model, "rank analysis")
    matrix = equilibrium_matrix(model)
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > tolerance * values[0])) if values.size else 0
    free = left[:, rank:]
    rigid = rigid_body_motions(model)
    if rigid.shape[1]:
        projected = free - rigid @ (rigid.T @ free)
        directions, sizes, _ = np.linalg.svd(projected, full_matrices=False)
        free = directions[:, sizes > 0.5]  # the sizes are 0 (rigid) or 1 up to round-off
    fields = np.zeros((free.shape[1], len(model.nodes), 3))
    places = np.ix_(range(len(fields)), model.free_nodes, model.axes)
    fields[places] = free.T.reshape(-1, len(model.free_nodes), len(model.axes))
    return Analysis(*matrix.shape, values, rank, right[rank:].T, fields, rigid.shape[1])


def rigid_body_motions(model: Model) -> np.ndarray:
    """(F*D, r) orthonormal rigid-body velocities of the free nodes that leave the fixed nodes at rest."""
    fields = np.array(list(rigid_fields(model).values()))[:, :, model.axes]
    held = fields[:, model.fixed_nodes].reshape(len(fields), -1)
    combinations = _null_space(held.T)
    moving = fields[:, model.free_nodes].reshape(len(fields), -1).T @ combinations
    directions, sizes, _ = np.linalg.svd(moving, full_matrices=False)
    return directions[:, sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))]


def rigid_fields(model: Model) -> dict[str, np.ndarray]:
    """(N, 3) velocities by name: the structure's translations along its axes and its rotations, about the nodes' mean or, where
    nodes are fixed, about the mean of these; the farthest node turns at 1 m/s."""
    middle = model.nodes[model.fixed_nodes if model.fixed.any() else slice(None)].mean(axis=0)
    arm = model.nodes - middle
    arm = arm / max(1e-300, float(np.abs(arm).max()))
    fields = {f"translation along {'xyz'[axis]}": np.tile(np.eye(3)[axis], (len(arm), 1)) for axis in model.axes}
    for axis in range(3):
        if len(model.axes) == 3 or axis not in model.axes:
            fields[f"rotation about {'xyz'[axis]}"] = np.cross(np.eye(3)[axis], arm)
    return fields


def _null_space(matrix: np.ndarray) -> np.ndarray:
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < matrix.shape[1])  # right is square
    return right[int(np.sum(values > RANK_TOLERANCE * max(values[0], 1e-300))) :].T


# --- from a scene to a model -------------------------------------------------------------------------------------


def build_model(scene: Scene) -> Model:
    """The scene's structure at its start, with the rest lengths that its prestress asks for.

    Raises SceneError where the prestress is undetermined, a string would have to push, a rest length would be
    negative, no equilibrium exists, or the model cannot be simulated (see `simulable`).
    """
    _require_laws(scene)
    model = _at_given_coordinates(scene)
    tension = _prestress(scene, model)
    model = replace(model, rest_length=_rest_lengths(scene, model, tension))
    if scene.start == "equilibrium":
        _require_balance(scene, model)
    if scene.start == "settled":
        try:
            model = settle(model)
        except (NoEquilibrium, hysteresis.NoStableState) as failure:
            remedy = 'Change the prestress or the coordinates, or write start = "released".'
            raise scene.error("start", str(failure), remedy, scene.start) from None
    model = replace(model, current=_holding_currents(model))
    simulable.require(scene, model)
    return model


def _holding_currents(model: Model) -> np.ndarray:
    """(A,) A: the currents that hold the start tensions, i = r T / k_a."""
    tension = string_tension(model, _lengths(model.nodes, model.strings))
    motors = [(model.actuator[i], tension[i]) for i in model.actuated]
    return np.array([motor.radius * pull / motor.torque_constant for motor, pull in motors])


def _require_laws(scene: Scene) -> None:
    """Work out every element, of a string or not, and every damper; raise SceneError for one that has no force law."""
    for name, entry in scene.elements.items():
        try:
            laws.part_law(scene.element(name)) if entry.law != "hysteretic" else hysteresis.start(scene.element(name), 1.0)
        except InputError as failure:
            raise scene.error(f"elements.{name}", *_two_parts(failure)) from None
    for name in scene.dampers:
        try:
            laws.damping(scene.damper(name))
        except InputError as failure:
            raise scene.error(f"dampers.{name}", *_two_parts(failure)) from None
    for name, string in scene.strings.items():
        try:
            if string.element is not None and scene.elements[string.element].law != "hysteretic":
                laws.law(scene.element(string.element))
        except InputError as failure:
            raise scene.error(f"strings.{name}.element", *_two_parts(failure)) from None


def _two_parts(failure: TensegrityError) -> tuple[str, str]:
    """Problem and remedy of an error about a law, whose message has them on the two sides of a semicolon."""
    problem, _, remedy = str(failure).rpartition("; ")
    return problem or remedy, f"{remedy[:1].upper()}{remedy[1:]}." if problem else "Change the element or the stiffness."


def _stiffness(scene: Scene, string: str) -> float:
    """k of a string, N/m; where nothing uses one, that of its element as it begins to stretch."""
    given = scene.stiffness(string)
    if given is not None:
        return given
    return laws.law(scene.element(scene.strings[string].element)).stiffness(1e-300) or 1.0


def _at_given_coordinates(scene: Scene) -> Model:
    index = {name: i for i, name in enumerate(scene.nodes)}
    nodes = np.array([scene.position(name) for name in scene.nodes])
    fixed = set(scene.fixed)
    honeycombs = {name: NSH(entry.Q, entry.zeta, entry.h, entry.law) for name, entry in scene.nsh.items()}
    elements = {name: scene.element(name) for name in scene.elements}
    dampers = {name: scene.damper(name) for name in scene.dampers}
    actuators = {name: Actuator(**entry.model_dump()) for name, entry in scene.actuators.items()}
    return Model(
        name=scene.name,
        description=scene.description,
        axes=scene.axes,
        node_names=tuple(scene.nodes),
        bar_names=tuple(scene.bars),
        string_names=tuple(scene.strings),
        nodes=nodes,
        fixed=[name in fixed for name in scene.nodes],
        bars=[[index[node] for node in bar.nodes] for bar in scene.bars.values()],
        bar_mass=[bar.mass for bar in scene.bars.values()],
        strings=[[index[node] for node in string.nodes] for string in scene.strings.values()],
        stiffness=[_stiffness(scene, name) for name in scene.strings],
        damping=[scene.damping(name) for name in scene.strings],
        rest_length=np.zeros(len(scene.strings)),
        nsh=tuple(honeycombs.get(string.nsh) for string in scene.strings.values()),
        element=tuple(elements.get(string.element) for string in scene.strings.values()),
        damper=tuple(dampers.get(string.damper) for string in scene.strings.values()),
        damping_law=scene.damping_law,
        gravity=scene.gravity,
        nominal=nodes,
        actuator=tuple(actuators.get(string.actuator) for string in scene.strings.values()),
        point_mass=_in_node_order(scene.point_masses, index),
        drag=_in_node_order(scene.drag, index),
        moving=tuple(sorted(index[node] for node in scene.moving)),
    )


def _in_node_order(table: dict[str, float], index: dict[str, int]) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((index[node], value) for node, value in table.items()))


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
    try:
        _require_small(model, "finding tensions by equilibrium")
    except TooLarge as failure:
        name = model.string_names[unknown[0]]
        remedy = f"Give every string's tension in prestress.tension: {len(unknown)} are missing, first {name}."
        raise scene.error("prestress", str(failure), remedy, {}) from None
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
        pull = float(tension[i])
        try:
            stretch = string_elongation(model, i, pull)
        except (InputError, hysteresis.NoStableState) as failure:
            key = f"prestress.tension.{name}" if name in scene.prestress.tension else f"strings.{name}"
            raise scene.error(key, *_two_parts(failure)) from None
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
    if not model.fixed.any() and np.any(model.g):
        remedy = "No node is fixed, so nothing bears the weight: fix a node, or let it float with gravity = 0."
    raise scene.error(f"nodes.{node}", problem, remedy)


def _round_off(model: Model) -> float:
    """N: what round-off in the coordinates can leave unbalanced; BALANCED unless members are very stiff or loaded."""
    forces = np.abs(member_forces(model))
    return max(BALANCED, 16.0 * EPS * (_coordinate_force(model) + float(np.max(forces, initial=0.0))))


def _coordinate_force(model: Model) -> float:
    """N: the largest of stiffness times length, or times coordinate; a round-off in coordinates makes EPS of it."""
    reach = np.maximum(_lengths(model.nodes, model.strings), float(np.abs(model.nodes).max()))
    return float(np.max(model.stiffness * reach, initial=0.0))


# --- stability and settling --------------------------------------------------------------------------------------


class _Modes:
    """A tangent stiffness by its eigenvalues (r,), N/m, and eigenvectors (r, r): the linearised flow is solved exactly."""

    assembled = staticmethod(_dense)

    def __init__(self, tangent: np.ndarray):
        self.values, self.vectors = np.linalg.eigh(0.5 * (tangent + tangent.T))
        self.stiffest = float(np.abs(self.values).max(initial=0.0)) or 1.0

    def stable(self) -> bool:
        return is_stable(self.values)

    def lowest(self) -> tuple[float, np.ndarray]:
        """The lowest eigenvalue, N/m, and its eigenvector (r,)."""
        return float(self.values[0]), self.vectors[:, 0]

    def times(self, directions: np.ndarray) -> np.ndarray:
        """The stiffness times directions (r, m)."""
        return self.vectors @ (self.values[:, None] * (self.vectors.T @ directions))

    def lowest_beside(self, neutral: np.ndarray) -> float:
        """The lowest eigenvalue, N/m, across the orthonormal directions (r, k), which have none; inf: there is none."""
        if not neutral.size:
            return float(self.values.min(initial=np.inf))
        rest = np.linalg.qr(neutral, mode="complete")[0][:, neutral.shape[1] :]
        return float(np.linalg.eigvalsh(rest.T @ self.times(rest)).min(initial=np.inf))

    def way(self, pull: np.ndarray, time: float, negligible: float) -> np.ndarray | None:
        """(r,) where the flow goes in a time under a pull (r,), N; None: without end, or too far to say.

        A neutral direction with no more pull than `negligible`, such as a rigid-body motion, is left alone.
        """
        pull = self.vectors.T @ pull
        values = np.where(np.abs(self.values) < NEUTRAL * self.stiffest, 0.0, self.values)
        pull[(values == 0.0) & (np.abs(pull) <= negligible)] = 0.0
        if np.isinf(time) and not np.all((values > 0.0) | (pull == 0.0)):
            return None
        return self.vectors @ (_flow(values, time) * pull)


class _Factors:
    """A large tangent stiffness (r, r), N/m, by sparse factors: the linearised flow is solved by implicit Euler steps."""

    assembled = staticmethod(_sparse)

    def __init__(self, tangent: scipy.sparse.csc_array):
        self.tangent = (0.5 * (tangent + tangent.T)).tocsc()
        self.stiffest = float(abs(self.tangent).sum(axis=0).max(initial=0.0)) or 1.0  # a bound

    def factors(self, shift: float):
        """The factors of K + shift 1, None unless it is positive definite."""
        shifted = self.tangent + shift * scipy.sparse.eye_array(self.tangent.shape[0], format="csc")
        symmetric = {"SymmetricMode": True}
        try:
            found = scipy.sparse.linalg.splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
        except RuntimeError:  # singular
            return None
        # without row exchanges the pivots have the signs of the eigenvalues (Sylvester's law of inertia)
        definite = np.array_equal(found.perm_r, found.perm_c) and found.U.diagonal().min(initial=1.0) > 0.0
        return found if definite else None

    def stable(self) -> bool:
        return self.factors(NEUTRAL * self.stiffest) is not None

    def lowest(self) -> tuple[float, np.ndarray]:
        """The lowest eigenvalue, N/m, and its eigenvector (r,)."""
        values, vectors = self._lowest(1)
        return float(values[0]), vectors[:, 0]

    def times(self, directions: np.ndarray) -> np.ndarray:
        """The stiffness times directions (r, m)."""
        return self.tangent @ directions

    def lowest_beside(self, neutral: np.ndarray) -> float:
        """The lowest eigenvalue, N/m, across the orthonormal directions (r, k), which have none."""
        values, vectors = self._lowest(1 + neutral.shape[1])
        return float(values[np.linalg.norm(neutral.T @ vectors, axis=0) < 0.5].min(initial=np.inf))

    def _lowest(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        shift = 0.0 if count == 1 else 1e-4 * self.stiffest  # beside zeros others lose the digits that an inverse has of these
        while (factors := self.factors(shift)) is None:
            shift = max(4.0 * shift, NEUTRAL * self.stiffest)
        inverse = scipy.sparse.linalg.LinearOperator(self.tangent.shape, factors.solve, dtype=float)
        start = np.random.default_rng(0).standard_normal(len(factors.perm_r))
        return scipy.sparse.linalg.eigsh(self.tangent, count, sigma=-shift, OPinv=inverse, v0=start)

    def way(self, pull: np.ndarray, time: float, negligible: float) -> np.ndarray | None:
        """As of _Modes; a pull along a neutral direction is not left alone, but no step of infinite time follows it."""
        factors = self.factors(1.0 / time)
        return None if factors is None else factors.solve(pull)


class _Point(NamedTuple):
    """The structure at one configuration, along the directions that keep the bars' lengths.

    energy: V, J; basis: (F*D, r) orthonormal directions; pull: (r,) N, -grad V; tangent: the tangent stiffness there.
    """

    energy: float
    basis: np.ndarray | scipy.sparse.csc_array
    pull: np.ndarray
    tangent: _Modes | _Factors

    @property
    def values(self) -> np.ndarray:
        """Rising eigenvalues (r,) of the tangent stiffness, N/m; of a small structure."""
        return self.tangent.values

    @property
    def vectors(self) -> np.ndarray:
        """Eigenvectors (r, r) of the tangent stiffness; of a small structure."""
        return self.tangent.vectors


class _Surface:
    """A model under constant loads, as a potential energy over the positions that keep the bars' lengths.

    branches: where the strings with memory stand; `keep` moves them along, and without it they stay.
    """

    def __init__(self, model: Model, force, decomposition=None, branches: Branches | None = None):
        self.model, self.load = model, loads(model, force)
        self.bar_length = _lengths(model.nominal, model.bars)
        self.place = places(model)
        self.size = _freedoms(model)
        self.decomposition = decomposition or (_Modes if self.size <= SMALL else _Factors)
        length = _lengths(model.nodes, model.strings)
        self.branches = string_branches(model, length) if branches is None else branches
        tension = string_tension(model, length, self.branches)
        largest_force = float(np.max(tension, initial=0.0) + np.abs(self.load).max())
        self.balanced = max(0.5 * BALANCED, 16.0 * EPS * (_coordinate_force(model) + largest_force))
        span = float(np.ptp(model.nodes, axis=0).max())
        self.reach = _step_limit(model)
        self.nearly_balanced = max(self.balanced, 1e-6 * largest_force)
        self.energy_round_off = 16.0 * EPS * float(np.sum(tension * length) + np.abs(self.load).sum() * span)

    def keep(self, nodes: np.ndarray) -> None:
        """Strings with memory follow to these positions for good."""
        if self.branches:
            self.branches = string_branches(self.model, _lengths(nodes, self.model.strings), self.branches)

    def energy(self, nodes: np.ndarray) -> float:
        stored = string_energy(self.model, _lengths(nodes, self.model.strings), self.branches)
        return float(stored.sum() - np.sum(self.load * (nodes - self.model.nodes)))

    def at(self, nodes: np.ndarray) -> _Point:
        """Energy, force and tangent stiffness along the directions that keep the bars' lengths."""
        strings = self.model.strings
        along = nodes[strings[:, 1]] - nodes[strings[:, 0]]
        length = np.linalg.norm(along, axis=1)
        density = string_tension(self.model, length, self.branches) / length
        total = self.load.copy()
        np.add.at(total, strings[:, 0], density[:, None] * along)
        np.add.at(total, strings[:, 1], -density[:, None] * along)
        basis = self._basis(nodes)
        tangent = basis.T @ self._stiffness(along, length, density, self._bar_density(nodes, total)) @ basis
        return _Point(self.energy(nodes), basis, basis.T @ _rows(self.model, total), self.decomposition(tangent))

    def gone(self, nodes: np.ndarray) -> float:
        """m, the longest way of a coordinate from the model's start."""
        return float(np.abs(nodes - self.model.nodes).max())

    def near(self, nodes: np.ndarray, step: np.ndarray) -> bool:
        """Whether a step (F*D,) from nodes (N, 3) is small beside the structure."""
        return bool(np.abs(step).max(initial=0.0) <= self.reach)

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

    def _basis(self, nodes: np.ndarray):
        """(F*D, r): orthonormal directions that keep the bars' lengths, few nodes in each.

        A bar contributes its turning about each direction across it and, if both ends are free, its translations; a node on no
        bar its own.
        """
        bars, axes = self.model.bars, self.model.axes
        first, second = self.place[bars[:, 0]], self.place[bars[:, 1]]  # (B, D)
        afloat = (first[:, 0] >= 0) & (second[:, 0] >= 0)
        across = _across((nodes[bars[:, 1]] - nodes[bars[:, 0]])[:, axes])  # (B, D, D-1)
        across *= np.where(afloat, math.sqrt(0.5), 1.0)[:, None, None]
        turns = np.arange(len(bars) * across.shape[2]).reshape(-1, 1, across.shape[2])
        shifts = turns.size + np.arange(afloat.sum() * len(axes)).reshape(-1, len(axes))
        rows = [*(np.broadcast_to(end[:, :, None], across.shape).ravel() for end in (first, second))]
        rows += [first[afloat].ravel(), second[afloat].ravel()]
        turning = np.broadcast_to(turns, across.shape).ravel()
        columns = [turning, turning, shifts.ravel(), shifts.ravel()]
        values = [-across.ravel(), across.ravel(), np.full(2 * shifts.size, math.sqrt(0.5))]
        lone = self.place[self.model.lone_nodes].ravel()
        if len(lone):
            rows.append(lone)
            columns.append(turns.size + shifts.size + np.arange(len(lone)))
            values.append(np.ones(len(lone)))
        shape = (self.size, turns.size + shifts.size + len(lone))
        return self.decomposition.assembled(np.concatenate(rows), np.concatenate(columns), np.concatenate(values), shape)

    def _bar_density(self, nodes: np.ndarray, total: np.ndarray) -> np.ndarray:
        """(B,) N/m: bar force densities that balance the nodal forces (N, 3) best; no two bars share a node."""
        felt = np.zeros_like(total)
        movable = np.ix_(self.model.free_nodes, self.model.axes)
        felt[movable] = total[movable]
        first, second = self.model.bars.T
        bar = nodes[second] - nodes[first]
        free_ends = 2.0 - self.model.fixed[first] - self.model.fixed[second]
        return np.sum(bar * (felt[second] - felt[first]), axis=1) / (free_ends * np.sum(bar**2, axis=1))

    def _stiffness(self, along, length, density, bar_density):
        """(F*D, F*D) N/m: a string's block is k u u^T + density (1 - u u^T), a bar's density times 1."""
        axes = self.model.axes
        unit = (along / length[:, None])[:, axes]
        material = string_stiffness(self.model, length, self.branches) - density
        blocks = np.concatenate([density, bar_density])[:, None, None] * np.eye(len(axes))
        blocks[: len(unit)] += material[:, None, None] * unit[:, :, None] * unit[:, None, :]
        ends = self.place[members(self.model)]  # (S+B, 2, D)
        pairs = ((0, 0), (0, 1), (1, 0), (1, 1))
        rows = np.stack([ends[:, i, :, None] for i, _ in pairs])
        columns = np.stack([ends[:, j, None, :] for _, j in pairs])
        values = np.stack([blocks if i == j else -blocks for i, j in pairs])
        return self.decomposition.assembled(rows, columns, values, (self.size, self.size))


def _across(along: np.ndarray) -> np.ndarray:
    """(B, D) -> (B, D, D-1): orthonormal directions across each vector, from its Householder reflection."""
    mirror = along / np.linalg.norm(along, axis=1)[:, None]
    mirror[:, -1] += np.copysign(1.0, mirror[:, -1])
    reflection = np.eye(along.shape[1]) - mirror[:, :, None] * (2.0 * mirror / np.sum(mirror**2, axis=1)[:, None])[:, None, :]
    return reflection[:, :, :-1]


def tangent_stiffness(model: Model, force=None) -> np.ndarray:
    """Rising eigenvalues, N/m, of the tangent stiffness at the model's start, in the directions that keep the bars'
    lengths; negative: unstable; zero: neutral, as a rigid-body motion is.

    Raises TooLarge: time grows with the third power of the structure; see `stability`.
    """
    _require_small(model, "computing every eigenvalue of the tangent stiffness")
    return _Surface(model, force, _Modes).at(model.nodes).values


class Stability(NamedTuple):
    """stable: no eigenvalue of the tangent stiffness is negative beyond round-off; lowest: the lowest of them, N/m, those of
    rigid-body motions that nothing resists left out (inf: there is no other)."""

    stable: bool
    lowest: float


def stability(model: Model, force=None) -> Stability:
    """Stability of the model's start, of small and large structures."""
    point = _Surface(model, force).at(model.nodes)
    return Stability(point.tangent.stable(), point.tangent.lowest_beside(_neutral(point, rigid_body_motions(model))))


def _neutral(point: _Point, motions: np.ndarray) -> np.ndarray:
    """(r, k) orthonormal: what of motions (F*D, m) the tangent stiffness does not resist, along the point's directions."""
    along = point.basis.T @ motions
    _, sizes, combinations = np.linalg.svd(point.tangent.times(along), full_matrices=along.shape[0] < along.shape[1])
    free = np.ones(along.shape[1], dtype=bool)
    free[: len(sizes)] = sizes <= 10.0 * NEUTRAL * point.tangent.stiffest
    return np.linalg.qr(along @ combinations[free].T)[0]


def is_stable(values: np.ndarray) -> bool:
    """Whether no eigenvalue (r,), N/m, of a tangent stiffness is negative beyond round-off."""
    return bool(values.min(initial=0.0) >= -NEUTRAL * np.abs(values).max(initial=0.0))


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
    nodes = model.nodes
    branches = string_branches(model, _lengths(nodes, model.strings))
    for step in range(1, steps + 1):
        part = step / steps  # exactly 1 at the end
        loaded = replace(model, rest_length=(1.0 - part) * model.rest_length + part * goal)
        surface = _Surface(loaded, (1.0 - part) * first + part * last, branches=branches)
        nodes = descend(surface, nodes, surface.balanced if step == steps else surface.nearly_balanced)
        branches = surface.branches
    settled, length = replace(model, nodes=nodes, rest_length=goal), _lengths(nodes, model.strings)
    anew = string_branches(settled, length)
    for i, branch in string_branches(settled, length, branches).items():
        if anew[i] != branch:
            name, count = model.string_names[i], anew[i].snapped
            raise NoEquilibrium(f"string {name} settles with {branch.snapped} of its parts snapped, but stretching it "
                                f"from slack leaves {count} so, and a start has no other memory")
    return settled


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
    nodes = surface.moved(nodes, np.zeros(surface.size))
    best, found, stalled, pace = np.inf, nodes, 0, np.inf
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
            nodes, best, stalled = surface.moved(found, 0.1 * surface.reach * direction), np.inf, 0
        else:
            nodes, pace = _flow_step(surface, nodes, point, pace)
        surface.keep(nodes)
    raise NoEquilibrium(
        f"no stable equilibrium was found: after {MAX_STEPS} steps, "
        f"{surface.gone(nodes):.3g} m away, {unbalanced:.3g} N are unbalanced"
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
    """m: longest way of a node in one step: small beside the structure, beside the beams of an NSH and falling stretches."""
    beams = [h for i in model.nsh_strings for h in model.nsh[i].h]
    made = [laws.law(element) for element in model.laws.values()]
    made += [laws.part_law(part) for element in model.memories.values() for part in element.parts]
    beams += [one.end - one.start for law in made for one in law.stretches if one.sign < 0]
    return min([5e-3 * float(model.bar_length.min()), *(0.2 * h for h in beams)])


def _unstable_direction(point: _Point) -> np.ndarray | None:
    """(F*D,) unit vector of the most unstable direction, its largest component positive; None at a minimum."""
    if point.tangent.stable():
        return None
    direction = point.basis @ point.tangent.lowest()[1]
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def _flow_step(
    surface: _Surface, nodes: np.ndarray, point: _Point, pace: float
) -> tuple[np.ndarray, float]:
    """One step of the flow, as long as the surface and the energy allow, and the time that it took.

    pace: the time that the step before took; a step without limit is tried first, then times from not much more on.
    """
    time, slowest = np.inf, 1e9 / point.tangent.stiffest
    while True:
        way = point.tangent.way(point.pull, time, surface.balanced)
        step = None if way is None else point.basis @ way
        if step is not None and surface.near(nodes, step):
            trial = surface.moved(nodes, step)
            # far down, the energy's round-off hides its fall: the step is then below what the energy can resolve
            if surface.energy(trial) <= point.energy + surface.energy_round_off:
                return trial, time
        time = 0.25 * time if np.isfinite(time) else min(slowest, 8.0 * pace)
        if time < 1e-21 * slowest:
            return surface.moved(nodes, step), time


def _flow(values: np.ndarray, time: float) -> np.ndarray:
    """(1 - exp(-w t))/w for each eigenvalue w: the way that a unit force goes in the time t."""
    if np.isinf(time):
        return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0.0)
    way = np.full_like(values, time)
    growth = np.clip(-values * time, None, 600.0)  # no overflow: such a step is too long anyway
    return np.divide(-np.expm1(growth), values, out=way, where=values != 0.0)
