"""The reference's equations: the article's matrix equations (1)-(7) in NumPy, one function each.

Independent of the C kernel on purpose.  Matrices follow the article: node coordinates N and velocities Ndot are 3 x n
(a column per node), C_s, C_b, C_r are the connectivities of strings, bars and bar centres.  Two errata of the article
are mended, see `mass_matrix` and `bar_force_density`.  Beyond the article: point masses, drag, moved nodes (`moved`) and,
with the sign of winding in, its eq. 8 (`actuator`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from . import actuator, hysteresis, laws
from . import nsh as honeycomb
from .actuator import Motors, motors_of
from .errors import InputError
from .model import Model
from .moved import Moved, moved_nodes

#: Least string length, m: keeps 0/0 out where a slack string's ends meet.
TINY = 1e-300


# --------------------------------------------------------------------------------------------- the article's equations

def connectivity(pairs: np.ndarray, n: int) -> np.ndarray:
    """C_s or C_b: a row per member, -1 at its first node and +1 at its second.  pairs: (members, 2)."""
    C = np.zeros((len(pairs), n))
    C[np.arange(len(pairs)), pairs[:, 0]] = -1.0
    C[np.arange(len(pairs)), pairs[:, 1]] = 1.0
    return C


def diagonal(A, B):
    """Diagonal of A^T B: the dot products of the columns."""
    return np.add.reduce(A * B)


def mass_matrix(C_b: np.ndarray, C_r: np.ndarray, J: np.ndarray, m: np.ndarray, m_p: np.ndarray) -> np.ndarray:
    """M = C_b^T J C_b + C_r^T m C_r of eq. 1, kg, plus the point masses m_p (n,) on its diagonal.

    Erratum: J_i = m_i / 12.  The article's m_i l_i^2 / 12 is a moment of inertia, and M must be a mass.
    """
    return (C_b.T * J) @ C_b + (C_r.T * m) @ C_r + np.diag(m_p)


def centred(C_b: np.ndarray, m: np.ndarray, m_p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bars with point masses, as if free: the moment of inertia about the centre of mass over l^2 (B,), kg, and the ends'
    places about the centre of mass in terms of the bar's vector (B, n).  Without point masses: m / 12, C_b / 2.

    In terms of M these are 1 / (C_b M^-1 C_b^T) and C_b M^-1 / (C_b M^-1 C_b^T), bar by bar.
    """
    first, second = (C_b < 0.0) @ m_p, (C_b > 0.0) @ m_p
    x = (0.5 * m + second) / (m + first + second)    # the centre's place along the bar, from the first node
    inertia = m / 12.0 + m * (0.5 - x) ** 2 + first * x ** 2 + second * (1.0 - x) ** 2
    return inertia, (C_b < 0.0) * -x[:, None] + (C_b > 0.0) * (1.0 - x)[:, None]


def string_motion(N, Ndot, C_s):
    """S = N C_s^T (3, S), lengths xi = |s| and their rates s . sdot / xi (the article's remark after eq. 3)."""
    S, Sdot = N @ C_s.T, Ndot @ C_s.T
    xi = np.maximum(np.sqrt(diagonal(S, S)), TINY)
    return S, xi, diagonal(S, Sdot) / xi


def elastic_tension(stretch, taut, piece, k, honeycombs, elements=(), branches=None):
    """f_s (S,) N: gamma xi of eq. 2 and eq. 9.  stretch: xi - xi0, m; taut: 1 or 0; piece: the piece of its force curve
    that each string uses; honeycombs: (string, NSH) of the strings with an NSH; elements: (string, Law) of those with
    another law; branches: string -> Branch of those with memory."""
    f = taut * k * stretch
    for j, nsh in honeycombs:
        f[j] = honeycomb.tabulated_force(nsh, piece.item(j), stretch.item(j), k.item(j))
    for j, law in elements:
        f[j] = law.force_on_piece(piece.item(j), stretch.item(j), k.item(j))
    for j, branch in (branches or {}).items():
        f[j] = branch.force(stretch.item(j))
    return f


def damping_tension(stretch_rate, taut, d, dampers=()):
    """f_d (S,) N: eta xi of eq. 3, or eq. 10, on taut strings only.  dampers: (string, Damping) of the others than linear."""
    f = taut * d * stretch_rate
    for j, law in dampers:
        f[j] = taut.item(j) * law.force(stretch_rate.item(j))
    return f


def bar_force_density(B, inertial, F, arms):
    """lambda (B,) N/m of eq. 1: -J l^-2 [Bdot^T Bdot] - l^-2 [B^T F C_b^T] / 2, diagonals only.

    inertial: the diagonal of J Bdot^T Bdot.  J and arms, which stands for C_b / 2: see `centred`; with point masses, too,
    this lambda leaves b . b'' + |b'|^2 = 0 under N'' M = F + B lambda C_b.
    Erratum: F = W - S (gamma + eta) C_s, the force on the nodes; the article has the strings' term with the other sign.
    """
    return (-diagonal(B, F @ arms.T) - inertial) / diagonal(B, B)


def stiffness_matrix(density, lam, C_s, C_b):
    """K = C_s^T (gamma + eta) C_s - C_b^T lambda C_b of eq. 1, N/m.  density: gamma + eta."""
    return (C_s.T * density) @ C_s - (C_b.T * lam) @ C_b


def constraint_forces(B, lam, F, acceleration, g: "Ground"):
    """F_c (3, n) N of eq. 1: forces of the ground that leave the fixed nodes with the acceleration (3, n) of their inputs
    (None: zero, no node is moved).

    lam, F: lambda and nodal forces without the ground's; they leave too large an acceleration by a at a fixed node g.
    Through W and through lambda, a force c there changes it by A c, A = p I - q b b^T / l^2, where b is the node's bar,
    p = (M^-1)_gg and q = arms_bg (C_b M^-1)_bg.  So c = -A^-1 a, A^-1 = (I + q / (p - q) b b^T / l^2) / p
    (Sherman and Morrison's formula).  Class 1: no other node's c enters.
    At an anchor, a fixed node without a bar, the ground balances the strings and moves the point mass.
    """
    a = F @ g.M_inv + (B * lam) @ g.C_b_M_inv
    if acceleration is not None:
        a = a - acceleration @ g.pins.T
        F = F - acceleration * g.anchor_mass
    b = B @ g.bars
    c = -(a + b * (g.ratio * diagonal(b, a) / diagonal(b, b))) / g.p
    return c @ g.pins - F * g.anchors


def first_order_form(N, Ndot, K, W, M_inv):
    """Xdot (3, 2n) of eq. 7, Xdot = X Z + V, with X = [N Ndot] (eq. 4), Z = [[0, -K M^-1], [I, 0]] (eq. 5) and
    V = [0, W M^-1] (eq. 6).  M_inv has zero rows and columns for anchors, which carry no mass."""
    n = N.shape[1]
    X = np.concatenate((N, Ndot), axis=1)
    Z = np.zeros((2 * n, 2 * n))
    Z[:n, n:] = -K @ M_inv
    Z[n:, :n] = np.eye(n)
    V = np.zeros((3, 2 * n))
    V[:, n:] = W @ M_inv
    return X @ Z + V


# ------------------------------------------------------------------------------------------------- what stays constant

class Ground(NamedTuple):
    """Fixed nodes.

    For the G of them that end a bar (pins): M_inv (n, G) and C_b_M_inv (B, G), the columns of M^-1 and of C_b M^-1;
    bars (B, G) selects the pin's bar, pins (G, n) the pin; p and ratio = q / (p - q) (G,), see `constraint_forces`.
    anchors (n,): 1 at fixed nodes without a bar; anchor_mass (n,): point masses there, kg.
    """

    M_inv: np.ndarray
    C_b_M_inv: np.ndarray
    bars: np.ndarray
    pins: np.ndarray
    p: np.ndarray
    ratio: np.ndarray
    anchors: np.ndarray
    anchor_mass: np.ndarray


@dataclass(frozen=True)
class Structure:
    """A model's constant matrices, in the article's notation.

    J (B,), arms (B, n): see `centred`; weight (3, n): gravity at the nodes, N; drag (n,): N s/m, other than 0 at the nodes
    `dragged`; lever (B, n): how a bar's nodes move when its vector changes about its centre of mass or pin;
    in_plane (3, 1): 1 on the axes that the scene uses;
    honeycombs: (string, NSH) of the strings that have one; elements: (string, Law) of those with another law without
    memory; slack: the slack branch of each string with memory; dampers: (string, Damping) of those that are not linear;
    breakpoints: per string the ends of its pieces, m; none of a string with memory.
    """

    model: Model
    C_s: np.ndarray
    C_b: np.ndarray
    J: np.ndarray
    arms: np.ndarray
    M: np.ndarray
    M_inv: np.ndarray
    ground: Ground
    moved: Moved
    motors: Motors
    weight: np.ndarray
    drag: np.ndarray
    dragged: np.ndarray
    lever: np.ndarray
    in_plane: np.ndarray
    honeycombs: tuple
    elements: tuple
    slack: dict
    dampers: tuple
    breakpoints: tuple


def structure(model: Model) -> Structure:
    """Work out the constant matrices.  Raises InputError for a model that is not class 1 or not well posed."""
    n = len(model.nodes)
    bar_of = _bar_of_node(model)
    C_s, C_b = connectivity(model.strings, n), connectivity(model.bars, n)
    C_r = 0.5 * np.abs(C_b)
    m_p, drag = np.zeros(n), np.zeros(n)
    for where, table in ((m_p, model.point_mass), (drag, model.drag)):
        for node, value in table:
            where[node] = value
    J, arms = centred(C_b, model.bar_mass, m_p)
    M = mass_matrix(C_b, C_r, model.bar_mass / 12.0, model.bar_mass, m_p)
    on_bar = np.flatnonzero(bar_of >= 0)
    M_inv = np.zeros((n, n))    # anchors have no mass and no acceleration
    M_inv[np.ix_(on_bar, on_bar)] = np.linalg.inv(M[np.ix_(on_bar, on_bar)])

    pins = np.flatnonzero(model.fixed & (bar_of >= 0))
    pin_bars = bar_of[pins]
    lever = arms.copy()
    lever[pin_bars] = C_b[pin_bars]
    lever[pin_bars, pins] = 0.0
    p, q = M_inv[pins, pins], arms[pin_bars, pins] * (C_b @ M_inv)[pin_bars, pins]
    anchors = (model.fixed & (bar_of < 0)).astype(float)
    ground = Ground(M_inv[:, pins], (C_b @ M_inv)[:, pins], np.eye(len(model.bars))[:, pin_bars], np.eye(n)[pins],
                    p, q / (p - q), anchors, anchors * m_p)

    in_plane = np.zeros((3, 1))
    in_plane[list(model.axes)] = 1.0
    weight = model.g[:, None] * (model.bar_mass @ C_r + m_p)
    honeycombs = tuple((j, model.nsh[j]) for j in model.plain_nsh_strings)
    elements = tuple((j, laws.law(element)) for j, element in model.laws.items())
    slack = {j: hysteresis.start(element, model.stiffness.item(j)) for j, element in model.memories.items()}
    dampers = tuple((j, laws.damping(damper)) for j, damper in enumerate(model.damper) if damper is not None)
    ends = dict.fromkeys(range(len(model.strings)), (0.0,))
    ends |= {j: tuple(honeycomb.breakpoints(nsh).tolist()) for j, nsh in honeycombs}
    ends |= {j: law.breakpoints for j, law in elements} | dict.fromkeys(slack, ())
    return Structure(model, C_s, C_b, J, arms, M, M_inv, ground, moved_nodes(model, M), motors_of(model), weight, drag,
                     np.flatnonzero(drag), lever, in_plane, honeycombs, elements, slack, dampers, tuple(ends.values()))


def _bar_of_node(model: Model) -> np.ndarray:
    """(n,) the bar that each node belongs to, -1 for none.  Raises InputError unless the equations apply."""
    bar_of = np.full(len(model.nodes), -1)
    for i, ends in enumerate(model.bars):
        for node in ends:
            if bar_of[node] >= 0:
                raise InputError(f"node {model.node_names[node]!r} belongs to two bars; a class-1 structure allows one")
            bar_of[node] = i
        if model.fixed[ends].all():
            raise InputError(f"bar {model.bar_names[i]!r} has both ends fixed; free one of them")
    for node in model.free_nodes:
        if bar_of[node] < 0:
            raise InputError(f"free node {model.node_names[node]!r} belongs to no bar and so has no mass; fix it")
    for node in model.moving:
        if not model.fixed[node]:
            raise InputError(f"moving names the free node {model.node_names[node]!r}; fix it, or let it move by itself")
    for node, _ in model.drag:
        if model.fixed[node]:
            raise InputError(f"drag names the fixed node {model.node_names[node]!r}; leave it out")
    if model.damping_law not in ("literal", "tension_only"):
        raise InputError(f"damping_law = {model.damping_law!r}: use 'literal' or 'tension_only'")
    return bar_of


# ------------------------------------------------------------------------------------------------- one instant in time

class Load(NamedTuple):
    """Inputs of one step: force (3, n) N; rest_length (S,) m at `since` (s), moving with rest_length_rate (S,) m/s (of a
    string with an actuator: its start rest length, and 0); current (A,) A; position, velocity and acceleration (3, E) of
    the moved nodes at `since`, m, m/s, m/s2; drum_load (A,) N, beside the tension of the string."""

    since: float
    force: np.ndarray
    rest_length: np.ndarray
    rest_length_rate: np.ndarray
    current: np.ndarray = np.zeros(0)
    position: np.ndarray = np.zeros((3, 0))
    velocity: np.ndarray = np.zeros((3, 0))
    acceleration: np.ndarray = np.zeros((3, 0))
    drum_load: np.ndarray | float = 0.0


#: Angles delta (rad) and speeds delta' (rad/s) of the actuators, (2, A), of a structure without actuators.
NO_WINDING = np.zeros((2, 0))


class Mode(NamedTuple):
    """Per string: the piece of the force curve that it follows; whether its tension is clipped at zero; the
    elongations (m) at which the piece begins and ends; taut and pulls: 1 where it is not slack, not clipped, else 0.

    branches: the branch of each string with memory, whose piece is 0 where it is slack and else one more than the number of
    its snapped parts."""

    piece: np.ndarray
    clipped: np.ndarray
    taut: np.ndarray
    pulls: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    branches: dict


class Strings(NamedTuple):
    """Per string at one instant: S (3, S), xi, stretch xi - xi0, its rate, elastic tension, tension before clipping,
    tension; m, m/s, N."""

    S: np.ndarray
    xi: np.ndarray
    stretch: np.ndarray
    rate: np.ndarray
    elastic: np.ndarray
    unclipped: np.ndarray
    tension: np.ndarray


class Motion(NamedTuple):
    """Everything that follows from a state: strings, lambda (B,), ground's forces (3, n), Xdot (3, 2n), delta'' (A,)."""

    strings: Strings
    lam: np.ndarray
    ground: np.ndarray
    Xdot: np.ndarray
    winding: np.ndarray


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
    S, xi, xi_rate = string_motion(N, Ndot, s.C_s)
    xi0, xi0_rate = rest_lengths(s, load, t, winding)
    stretch = xi - xi0
    rate = xi_rate - xi0_rate
    elastic = elastic_tension(stretch, mode.taut, mode.piece, s.model.stiffness, s.honeycombs, s.elements, mode.branches)
    unclipped = elastic + damping_tension(rate, mode.taut, s.model.damping, s.dampers)
    return Strings(S, xi, stretch, rate, elastic, unclipped, unclipped * mode.pulls)


def motion_at(s: Structure, load: Load, mode: Mode, t: float, N, Ndot, winding=NO_WINDING) -> Motion:
    """Equation 1 and its first order form, and equation 8, at one instant."""
    strings = strings_at(s, load, mode, t, N, Ndot, winding)
    density = strings.tension / strings.xi
    B, Bdot = N @ s.C_b.T, Ndot @ s.C_b.T
    inertial = s.J * diagonal(Bdot, Bdot)
    W = load.force + s.weight
    if len(s.dragged):
        W = W - s.drag * Ndot
    F = W - (strings.S * density) @ s.C_s
    lam = bar_force_density(B, inertial, F, s.arms)
    acceleration = load.acceleration @ s.moved.select if len(s.moved.nodes) else None
    ground = constraint_forces(B, lam, F, acceleration, s.ground)
    lam = bar_force_density(B, inertial, F + ground, s.arms)
    K = stiffness_matrix(density, lam, s.C_s, s.C_b)
    Xdot = first_order_form(N, Ndot, K, W + ground, s.M_inv)
    if acceleration is not None:
        Xdot[:, N.shape[1]:] += acceleration * s.ground.anchors
    return Motion(strings, lam, ground, Xdot, motor_acceleration(s, load, strings, winding))


def motor_acceleration(s: Structure, load: Load, strings: Strings, winding):
    """delta'' (A,) of eq. 8 under the tensions of the strings."""
    if not len(s.motors.strings):
        return winding[1]
    return actuator.acceleration(s.motors, load.current, strings.tension[s.motors.strings] + load.drum_load, winding[1])


def powers(s: Structure, load: Load, motion: Motion, Ndot, winding=NO_WINDING) -> tuple[float, float, float]:
    """Input power, dissipated power, and the sum of the absolute values of their terms, W.

    A term of the input per node's force, string's moving rest length, moved node's reaction, and motor's current; of the
    loss per string's damper, node's drag, and motor's damping.
    """
    strings = motion.strings
    put_in = np.concatenate((diagonal(load.force, Ndot), -strings.tension * load.rest_length_rate))
    lost = (strings.tension - strings.elastic) * strings.rate
    if len(s.moved.nodes):
        put_in = np.concatenate((put_in, diagonal(motion.ground, Ndot)[s.moved.nodes]))
    if len(s.dragged):
        lost = np.concatenate((lost, (s.drag * diagonal(Ndot, Ndot))[s.dragged]))
    if len(s.motors.strings):
        pulled_out = -s.motors.radius * winding[1] * load.drum_load
        put_in = np.concatenate((put_in, actuator.input_power(s.motors, load.current, winding[1]), pulled_out))
        lost = np.concatenate((lost, actuator.lost_power(s.motors, winding[1])))
    total = np.add.reduce
    return total(put_in), total(lost), total(np.abs(put_in)) + total(np.abs(lost))


def elastic_energy(s: Structure, stretch, branches: dict | None = None) -> float:
    """Energy stored in the strings, J.  branches: string -> Branch of those with memory."""
    k, carriers, elements = s.model.stiffness, dict(s.honeycombs), dict(s.elements)

    def stored(j, x):
        if j in carriers:
            return honeycomb.energy(carriers[j], x, k[j])
        if j in elements:
            return elements[j].energy(x, k[j])
        return branches[j].energy(x) if branches and j in branches else 0.5 * k[j] * max(x, 0.0) ** 2

    return sum(stored(j, x) for j, x in enumerate(stretch.tolist()))


def kinetic_energy(s: Structure, Ndot, winding=NO_WINDING) -> float:
    """Kinetic energy of bars, point masses and motors, J."""
    return 0.5 * np.trace(Ndot @ s.M @ Ndot.T) + actuator.kinetic_energy(s.motors, winding[1])


def potential_energy(s: Structure, N) -> float:
    """Potential energy by gravity, J."""
    return -np.sum(s.weight * N)


def on_constraints(s: Structure, N, Ndot):
    """N, Ndot moved back on |b| = l and b . bdot = 0, along the bars only."""
    B, Bdot = N @ s.C_b.T, Ndot @ s.C_b.T
    l2 = diagonal(B, B)
    stretch = s.model.bar_length / np.sqrt(l2) - 1.0
    along = diagonal(B, Bdot) / l2
    # The velocity's projection is unchanged by the position's, which keeps the bar's direction.
    return N + (B * stretch) @ s.lever, Ndot - (B * along) @ s.lever


def drift(s: Structure, N, Ndot) -> float:
    """Largest relative deviation of bar lengths; of b . bdot / l^2, in 1/s, or relative to velocities above 1 m/s."""
    B, Bdot = N @ s.C_b.T, Ndot @ s.C_b.T
    l2 = s.model.bar_length ** 2
    speed = max(1.0, np.abs(Ndot).max())
    deviations = np.abs(diagonal(B, B) / l2 - 1.0) / 2.0, np.abs(diagonal(B, Bdot)) / (l2 * speed)
    return float(np.concatenate(deviations).max(initial=0.0))


def fastest_rate(s: Structure) -> float:
    """Upper bound on how fast dampers and drag slow nodes and motors down, 1/s: largest eigenvalue of D M^-1, with
    D = C_s^T d C_s + drag; and d_a / J_a.  A damper between a node and a motor counts twice at both:
    d (xi' + r delta')^2 <= 2 d xi'^2 + 2 d (r delta')^2."""
    d, motors = s.model.damping.copy(), s.motors
    for j, law in s.dampers:
        d[j] = max(law.slope(rate) for rate in (0.0, 1.0, *law.kinks))    # a bound for rates up to 1 m/s
    d[motors.strings] *= 2.0
    damping = (s.C_s.T * d) @ s.C_s + np.diag(s.drag)
    of_motors = (motors.damping + motors.radius ** 2 * d[motors.strings]) / motors.inertia
    return float(max(np.abs(np.linalg.eigvals(damping @ s.M_inv)).max(initial=0.0), of_motors.max(initial=0.0)))


def mode_of(s: Structure, piece: np.ndarray, clipped: np.ndarray, branches: dict | None = None) -> Mode:
    """A mode from its pieces and clips.  branches: string -> Branch of those with memory, whose pieces follow from it; without,
    they are slack."""
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
    return Mode(piece, clipped, (piece > 0).astype(float), (~clipped).astype(float), lower, upper, branches)


def gaps(s: Structure, mode: Mode, strings: Strings) -> np.ndarray:
    """(3, S) how far each string is from the lower end of its piece, from the upper end (m), and from being clipped or
    released (N); a transition is due where a gap becomes negative."""
    found = np.full((3, len(mode.piece)), np.inf)
    found[0] = strings.stretch - mode.lower
    found[1] = mode.upper - strings.stretch
    if s.model.damping_law == "tension_only":
        sign = np.where(mode.clipped, -1.0, 1.0)
        found[2] = np.where(mode.piece > 0, sign * strings.unclipped, np.inf)
    return found
