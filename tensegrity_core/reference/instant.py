"""The reference's equations at an instant: strings, motion, powers, energies, the bars' constraints."""

from __future__ import annotations

from dataclasses import make_dataclass
from typing import Any, NamedTuple

import numpy as np

from ..model import Inputs
from ..model.inputs import INPUTS
from . import motors as actuator
from .equations import bar_force_density, damping_tension, diagonal, elastic_tension, lengths, string_motion
from .joints import Joints
from .structure import Structure


def ground_forces(s: Structure, Nddot, F, bars):
    """Forces of the ground on the structure (3, n) N: at the fixed nodes, what eq. 1 lacks there under the other forces F and
    those of the bars, B lambda C_b."""
    return (Nddot.dot(s.M) - F - bars) * s.held


_Load: Any = make_dataclass("_Load", ["since", *((name, Any, 0.0) for name in INPUTS)], frozen=True)


class Load(_Load):
    """Inputs of one step, each by its name in fields.py, as they are at `since` (s): vectors as columns, such as force (3, n) N
    and node_position (3, E) m, others as there, such as rest_length (S,) m, which moves with rest_length_rate (S,) m/s (of a
    string with an actuator: its start rest length, and 0)."""


def load_of(s: Structure, inputs: Inputs, k: int) -> Load:
    """The inputs of step k, those that are vectors in the axes that the scene uses."""
    found = {name: getattr(inputs, name)[k] for name in INPUTS}
    for name, field in INPUTS.items():
        if "D" in field.shape:
            found[name] = np.atleast_2d(found[name]).T * (s.moved_axes if "E" in field.shape else s.in_plane)
    home = s.model.nodes[s.moved.nodes].T
    found["node_position"] = np.where(s.moved_axes > 0.0, found["node_position"], home)
    return Load(float(inputs.times[k]), **found)


def external_force(s: Structure, load: Load):
    """Forces from outside on the nodes (3, n) N: what F of eq. 1 has beside strings, weight and drag.  Their power is input."""
    return load.force


#: Angles delta (rad) and speeds delta' (rad/s) of the actuators, (2, A), of a structure without actuators.
NO_WINDING = np.zeros((2, 0))
#: Modes (K,) of the contacts of a structure without ground.
NO_CONTACT = np.zeros(0, dtype=int)


class Mode(NamedTuple):
    """Per string: the piece of the force curve that it follows; whether its tension is clipped at zero; the
    elongations (m) at which the piece begins and ends; taut and pulls: 1 where it is not slack, not clipped, else 0.  A spring
    that also pushes is always on piece 0, and taut.

    contact (K,): the mode of each contact, a place in CONTACT_MODES.
    branches: the branch of each string with memory, whose piece is 0 where it is slack and else one more than the number of
    its snapped parts; k, d (S,), curves and damper_curves: the forces, see `elastic_tension` and `damping_tension`."""

    piece: np.ndarray
    clipped: np.ndarray
    taut: np.ndarray
    pulls: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    branches: dict
    k: np.ndarray
    d: np.ndarray
    curves: tuple
    damper_curves: tuple
    contact: np.ndarray


class Strings(NamedTuple):
    """Per string at one instant: xi, elongation xi - xi0, its rate, elastic tension, tension before clipping, tension; m, m/s,
    N."""

    xi: np.ndarray
    elongation: np.ndarray
    rate: np.ndarray
    elastic: np.ndarray
    unclipped: np.ndarray
    tension: np.ndarray


class Motion(NamedTuple):
    """Everything that follows from a state: strings, lambda (B,), N'' (3, n), forces F on the nodes but the bars' and the
    ground's on fixed ones (3, n), forces of the ground on these (3, n; None where not asked for), delta'' (A,); the contacts
    with the ground, None without."""

    strings: Strings
    lam: np.ndarray
    Nddot: np.ndarray
    F: np.ndarray
    ground: Any
    winding: np.ndarray
    touching: Any = None  # Touching
    slipping: Any = None  # Slipping


def rest_lengths(s: Structure, load: Load, t: float, winding):
    """xi0 and its rate (S,), m, m/s: those of the inputs, and xi0(0) - r delta where an actuator winds."""
    xi0, rate = load.rest_length + load.rest_length_rate * (t - load.since), load.rest_length_rate
    if len(s.motors.strings):
        wound = np.zeros((2, len(xi0)))
        wound[:, s.motors.strings] = s.motors.radius * winding
        xi0, rate = xi0 - wound[0], rate - wound[1]
    return xi0, rate


def strings_at(s: Structure, load: Load, mode: Mode, t: float, N, Ndot, winding=NO_WINDING) -> Strings:
    """Kinematics and tensions of all strings under the pieces that `mode` holds."""
    _, xi, xi_rate = string_motion(N, Ndot, s.C_s)
    return _strings(s, load, mode, t, xi, xi_rate, winding)


def _strings(s: Structure, load: Load, mode: Mode, t: float, xi, xi_rate, winding) -> Strings:
    """xi, xi_rate (G,): of the segments; a routed string's are the sums of its segments'."""
    if s.route is not None:
        xi, xi_rate = s.route.dot(xi), s.route.dot(xi_rate)
    xi0, xi0_rate = rest_lengths(s, load, t, winding)
    elongation = xi - xi0
    rate = xi_rate - xi0_rate
    elastic = elastic_tension(elongation, mode.k, mode.curves)
    unclipped = elastic + damping_tension(rate, mode.d, mode.damper_curves)
    return Strings(xi, elongation, rate, elastic, unclipped, unclipped * mode.pulls)


def motion_at(
    s: Structure, load: Load, mode: Mode, t: float, N, Ndot, winding=NO_WINDING, ground: bool = True, bristle=None
) -> Motion:
    """Equation 1 and equation 8 at one instant.  ground: also the forces of the ground on fixed nodes, for which moved nodes
    ask anyway; bristle (d, K): of the state, where nodes may touch the ground."""
    if s.contacts is None:
        return _motion(s, load, mode, t, N, Ndot, winding, ground)
    touching = s.contacts.at(load, mode.contact, t, N, Ndot, bristle)
    found = _motion(s, load, mode, t, N, Ndot, winding, ground, s.contacts.forces(touching))
    slipping = s.contacts.slipping(touching, found.Nddot)
    return found._replace(touching=touching, slipping=slipping)


def _motion(s: Structure, load: Load, mode: Mode, t: float, N, Ndot, winding, ground: bool, pressed=None) -> Motion:
    """pressed: (3, n) forces of the ground on nodes that touch it, None: there are none."""
    m = len(s.C_s)
    members, rates = N.dot(s.C), Ndot.dot(s.C)  # [S B], [Sdot Bdot]
    S, B = members[:, :m], members[:, m:]
    squares = diagonal(members, members)
    xi = lengths(squares[:m])
    strings = _strings(s, load, mode, t, xi, diagonal(S, rates[:, :m]) / xi, winding)
    tension = strings.tension if s.route is None else strings.tension.dot(s.route)  # one along the whole path
    F = external_force(s, load) + s.weight - (S * (tension / xi)).dot(s.C_s)
    if len(s.dragged):
        F -= s.drag * Ndot
    if pressed is not None:
        F += pressed
    if s.joints is not None:
        return _jointed_motion(s, s.joints, load, strings, N, Ndot, F, winding)
    free, moved = F, len(s.moved.nodes) > 0
    if moved:  # the columns of eq. 1 at the free nodes hold the accelerations of the others, too
        given = load.node_acceleration.dot(s.moved.select)
        free = F - given.dot(s.M)
    lam = bar_force_density(B, rates[:, m:], squares[m:], free, s.J, s.arms)
    if moved:
        lam -= s.J * diagonal(B, given.dot(s.C_b.T)) / squares[m:]
    Nddot = free.dot(s.M_inv) + (B * lam).dot(s.C_b_M_inv)
    if moved:
        Nddot += given
    forces = ground_forces(s, Nddot, F, (B * lam).dot(s.C_b)) if ground or moved else None
    return Motion(strings, lam, Nddot, F, forces, motor_acceleration(s, load, strings, winding))


def _jointed_motion(s: Structure, joints: Joints, load: Load, strings: Strings, N, Ndot, F, winding) -> Motion:
    """The same of a model beyond class 1."""
    given = load.node_acceleration.dot(s.moved.select)
    solved = joints.motion(N, Ndot, F, given)
    ground = ground_forces(s, solved.acceleration, F, solved.forces)
    lam = solved.lam[: len(s.C_b)]
    return Motion(strings, lam, solved.acceleration, F, ground, motor_acceleration(s, load, strings, winding))


def motor_acceleration(s: Structure, load: Load, strings: Strings, winding):
    """delta'' (A,) of eq. 8 under the tensions of the strings."""
    if not len(s.motors.strings):
        return winding[1]
    return actuator.acceleration(s.motors, load.current, strings.tension[s.motors.strings] + load.drum_load, winding[1])


def powers(s: Structure, load: Load, motion: Motion, Ndot, winding=NO_WINDING) -> tuple[float, float, float]:
    """Input power, dissipated power, and the sum of the absolute values of their terms, W.

    A term of the input per node's force, string's moving rest length, moved node's reaction, motor's current, and contact with
    a ground that moves; of the loss per string's damper, node's drag, motor's damping, and contact's damping and slip.
    """
    strings = motion.strings
    put_in = np.concatenate((diagonal(external_force(s, load), Ndot), -strings.tension * load.rest_length_rate))
    lost = (strings.tension - strings.elastic) * strings.rate
    if len(s.moved.nodes):
        put_in = np.concatenate((put_in, diagonal(motion.ground, Ndot)[s.moved.nodes]))
    if len(s.dragged):
        lost = np.concatenate((lost, (s.drag * diagonal(Ndot, Ndot))[s.dragged]))
    if len(s.motors.strings):
        pulled_out = -s.motors.radius * winding[1] * load.drum_load
        put_in = np.concatenate((put_in, actuator.input_power(s.motors, load.current, winding[1]), pulled_out))
        lost = np.concatenate((lost, actuator.lost_power(s.motors, winding[1])))
    if s.contacts is not None:
        lifted, pressed, rubbed = s.contacts.powers(motion.touching, motion.slipping)
        put_in, lost = np.concatenate((put_in, lifted)), np.concatenate((lost, pressed, rubbed))
    total = np.add.reduce
    return total(put_in), total(lost), total(np.abs(put_in)) + total(np.abs(lost))


def elastic_energy(s: Structure, elongation, branches: dict | None = None) -> float:
    """Energy stored in the strings, J.  branches: string -> Branch of those with memory."""
    values = zip(s.model.stiffness.tolist(), elongation.tolist(), s.least)
    stored = [0.5 * k * max(x, least) ** 2 for k, x, least in values]
    for j, law in (s.laws | (branches or {})).items():
        stored[j] = law.energy(elongation.item(j))
    return sum(stored)


def kinetic_energy(s: Structure, Ndot, winding=NO_WINDING) -> float:
    """Kinetic energy of bars, point masses and motors, J."""
    return 0.5 * np.trace(Ndot @ s.M @ Ndot.T) + actuator.kinetic_energy(s.motors, winding[1])


def potential_energy(s: Structure, N) -> float:
    """Potential energy by gravity, J."""
    return -np.sum(s.weight * N)


def on_constraints(s: Structure, N, Ndot) -> tuple[np.ndarray, np.ndarray]:
    """N, Ndot moved back on |b| = l and b . bdot = 0, along the bars only; see `joints` for what shares nodes."""
    if s.joints is not None:
        return s.joints.back(N, Ndot)
    B, Bdot = N.dot(s.C_b.T), Ndot.dot(s.C_b.T)
    l2 = diagonal(B, B)
    change = s.model.bar_length / np.sqrt(l2) - 1.0
    along = diagonal(B, Bdot) / l2
    # The velocity's projection is unchanged by the position's, which keeps the bar's direction.
    return N + (B * change).dot(s.arms), Ndot - (B * along).dot(s.arms)


def drift(s: Structure, N, Ndot) -> float:
    """Largest relative deviation of bar lengths; of b . bdot / l^2, in 1/s, or relative to velocities above 1 m/s."""
    if s.joints is not None:
        return s.joints.drift(N, Ndot)
    B, Bdot = N.dot(s.C_b.T), Ndot.dot(s.C_b.T)
    l2 = s.model.bar_length**2
    speed = max(1.0, np.abs(Ndot).max())
    deviations = np.abs(diagonal(B, B) / l2 - 1.0) / 2.0, np.abs(diagonal(B, Bdot)) / (l2 * speed)
    return float(np.concatenate(deviations).max(initial=0.0))


def fastest_rate(s: Structure) -> float:
    """Upper bound on how fast dampers and drag slow nodes and motors down, 1/s: largest eigenvalue of D M^-1, with
    D = C_s^T d C_s + drag; and d_a / J_a.  A damper between a node and a motor counts twice at both:
    d (xi' + r delta')^2 <= 2 d xi'^2 + 2 d (r delta')^2; one over m segments m times at each, for the same reason."""
    d, motors = s.model.damping.copy(), s.motors
    for j, law in s.dampers:
        d[j] = max(law.slope(rate) for rate in (0.0, 1.0, *law.kinks))  # a bound for rates up to 1 m/s
    d[motors.strings] *= 2.0
    of_segments = d if s.route is None else (d * s.route.sum(axis=1)).dot(s.route)
    damping = (s.C_s.T * of_segments) @ s.C_s + np.diag(s.drag)
    of_motors = (motors.damping + motors.radius**2 * d[motors.strings]) / motors.inertia
    inverses = (s.M_inv,) if s.joints is None else s.joints.M_inv
    of_nodes = max(np.abs(np.linalg.eigvals(damping @ M_inv)).max(initial=0.0) for M_inv in inverses)
    return float(max(of_nodes, of_motors.max(initial=0.0)))


def mode_of(
    s: Structure, piece: np.ndarray, clipped: np.ndarray, branches: dict | None = None, contact: np.ndarray = NO_CONTACT
) -> Mode:
    """A mode from its pieces, clips and contacts.  branches: string -> Branch of those with memory, whose pieces follow from
    it; without, they are slack."""
    branches = s.slack if branches is None else branches
    if branches:
        piece = piece.copy()
        piece[list(branches)] = [branch.snapped + 1 if branch.taut else 0 for branch in branches.values()]
        clipped = clipped & (piece > 0)
    lower, upper = np.full(len(piece), -np.inf), np.full(len(piece), np.inf)
    for j, (p, ends) in enumerate(zip(piece.tolist(), s.breakpoints)):
        if p > 0 and ends:
            lower[j] = ends[p - 1]
        if p < len(ends):
            upper[j] = ends[p]
    for j, branch in branches.items():
        lower[j], upper[j] = branch.lower, branch.upper
    taut, k = np.maximum(piece > 0, s.two_way), s.model.stiffness
    curves = tuple((j, law.on_piece(piece.item(j))) for j, law in (s.laws | branches).items())
    damper_curves = tuple((j, law.force) for j, law in s.dampers if taut[j])
    d = s.model.damping * taut
    d[[j for j, _ in s.dampers]] = 0.0
    pulls = (~clipped).astype(float)
    return Mode(piece, clipped, taut, pulls, lower, upper, branches, k * taut, d, curves, damper_curves, contact)


def gaps(s: Structure, mode: Mode, strings: Strings) -> np.ndarray:
    """(3, S) how far each string is from the lower end of its piece, from the upper end (m), and from being clipped or
    released (N); a transition is due where a gap becomes negative."""
    found = np.full((3, len(mode.piece)), np.inf)
    found[0] = strings.elongation - mode.lower
    found[1] = mode.upper - strings.elongation
    if s.model.damping_law == "tension_only":
        sign = np.where(mode.clipped, -1.0, 1.0)
        found[2] = np.where(mode.piece > 0, sign * strings.unclipped, np.inf)
    return found
