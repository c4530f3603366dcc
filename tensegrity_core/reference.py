"""The reference: the article's matrix equations (1)-(7) in NumPy, integrated by SciPy with tight tolerances.

Independent of the C kernel on purpose.  Matrices follow the article: node coordinates N and velocities Ndot are 3 x n
(a column per node), C_s, C_b, C_r are the connectivities of strings, bars and bar centres.  Two errata of the article
are mended, see `mass_matrix` and `bar_force_density`.

Between transitions the right-hand side is smooth: each string holds a *piece* of its force curve (0 slack; 1 taut, or
the pieces of an NSH) and, under the law 'tension_only', whether its tension is *clipped* at zero.  Where a string
reaches an end of its piece the step is repeated so that it ends there, the piece changes, and the integration restarts.
The instant is found on SciPy's dense output and then corrected by Newton steps until the gap is at round-off.

Bar lengths.  l_i = |b_i| of the current state stands in lambda, so that a deviation grows linearly only (with the
nominal lengths it grows exponentially).  On top, `on_constraints` puts N and Ndot back on |b_i| = l_i, b_i . bdot_i = 0
at every restart, at every output row, and as soon as the deviation exceeds `DRIFT`.  It moves the nodes along the bar
only, about the bar's centre (about the pin of a pinned bar): orthogonal in the mass metric, so centres of mass and
their velocities keep all digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853, Radau
from scipy.optimize import brentq, minimize_scalar

from . import nsh as honeycomb
from .errors import InputError, SimulationError
from .inputs import Inputs
from .model import Model
from .result import Result, Transition

class _Method(NamedTuple):
    """A SciPy solver.

    scale: factor on rtol and atol that makes the methods alike in the error they reach; velocity: factor on atol for
    velocities, whose errors the dampers let die out; dense: whether its dense output is good enough for rows, otherwise
    it stops at every row; implicit: whether it wants a Jacobian.
    """

    solver: type
    scale: float
    velocity: float
    dense: bool
    implicit: bool


#: The methods that `simulate` accepts, besides 'auto'.
METHODS = {"DOP853": _Method(DOP853, 1.0, 10.0, True, False), "Radau": _Method(Radau, 300.0, 1.0, False, True)}
#: Above this bound on the dampers' fastest rate (1/s) 'auto' takes Radau, below DOP853: about equal work there.
STIFF = 2e4
#: Largest deviation of the bars' constraints (see `drift`) that the integration carries along.
DRIFT = 1e-10
#: The same deviation beyond which a step is wrong rather than inaccurate.
BROKEN = 1e-2
#: Gaps (see `gaps`: m, m, N) below which strings that move out of their piece do so together with one that has arrived.
TOGETHER = np.array([1e-13, 1e-13, 1e-9])
#: Gaps no larger than this are zero to round-off (m, m, N).
ROUND_OFF = np.array([1e-15, 1e-15, 1e-11])
#: A string at the end of its piece whose rate (m/s) is below this follows its acceleration.
AT_REST = 1e-15
#: Points per step at which gaps are looked at once a transition is suspected.
SAMPLES = 16
#: Least string length, m: keeps 0/0 out where a slack string's ends meet.
TINY = 1e-300
#: Displacement (m) and velocity (m/s) over which derivatives are taken.
DIFFERENCE = 1e-7
#: First trial step of a run, s; SciPy's own choice is not safe against overflow.
FIRST_STEP = 1e-6
#: Absolute tolerance of the energy integrals, J.
LEDGER_ATOL = 1e-10
#: Steps between two rows after which a run gives up.
MAX_STEPS = 200_000
#: Changes of piece without the time moving on, after which a run gives up.
MAX_STALLED = 100


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


def mass_matrix(C_b: np.ndarray, C_r: np.ndarray, J: np.ndarray, m: np.ndarray) -> np.ndarray:
    """M = C_b^T J C_b + C_r^T m C_r of eq. 1, kg.

    Erratum: J_i = m_i / 12.  The article's m_i l_i^2 / 12 is a moment of inertia, and M must be a mass.
    """
    return (C_b.T * J) @ C_b + (C_r.T * m) @ C_r


def string_motion(N, Ndot, C_s):
    """S = N C_s^T (3, S), lengths xi = |s| and their rates s . sdot / xi (the article's remark after eq. 3)."""
    S, Sdot = N @ C_s.T, Ndot @ C_s.T
    xi = np.maximum(np.sqrt(diagonal(S, S)), TINY)
    return S, xi, diagonal(S, Sdot) / xi


def elastic_tension(stretch, taut, piece, k, honeycombs):
    """f_s (S,) N: gamma xi of eq. 2 and eq. 9.  stretch: xi - xi0, m; taut: 1 or 0; piece: the piece of its force curve
    that each string uses; honeycombs: (string, NSH) of the strings with an NSH."""
    f = taut * k * stretch
    for j, nsh in honeycombs:
        f[j] = honeycomb.tabulated_force(nsh, piece.item(j), stretch.item(j), k.item(j))
    return f


def damping_tension(stretch_rate, taut, d):
    """f_d (S,) N: eta xi of eq. 3, on taut strings only."""
    return taut * d * stretch_rate


def bar_force_density(B, inertial, F, C_b):
    """lambda (B,) N/m of eq. 1: -J l^-2 [Bdot^T Bdot] - l^-2 [B^T F C_b^T] / 2, diagonals only.

    inertial: the diagonal of J Bdot^T Bdot.
    Erratum: F = W - S (gamma + eta) C_s, the force on the nodes; the article has the strings' term with the other sign.
    """
    return (diagonal(B, F @ C_b.T) * -0.5 - inertial) / diagonal(B, B)


def stiffness_matrix(density, lam, C_s, C_b):
    """K = C_s^T (gamma + eta) C_s - C_b^T lambda C_b of eq. 1, N/m.  density: gamma + eta."""
    return (C_s.T * density) @ C_s - (C_b.T * lam) @ C_b


def constraint_forces(B, lam, F, g: "Ground"):
    """F_c (3, n) N of eq. 1: forces of the ground that leave the fixed nodes without acceleration.

    lam, F: lambda and nodal forces without the ground's; they leave an acceleration a at a fixed node g.  Through W
    and through lambda, a force c there changes it by A c, A = p I - q b b^T / l^2, where b is the node's bar,
    p = (M^-1)_gg and q = (C_b)_bg (C_b M^-1)_bg / 2.  So c = -A^-1 a, A^-1 = (I + q / (p - q) b b^T / l^2) / p
    (Sherman and Morrison's formula).  Class 1: no other node's c enters.
    At an anchor, a fixed node without a bar, the ground balances the strings.
    """
    a = F @ g.M_inv + (B * lam) @ g.C_b_M_inv
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
    anchors (n,): 1 at fixed nodes without a bar.
    """

    M_inv: np.ndarray
    C_b_M_inv: np.ndarray
    bars: np.ndarray
    pins: np.ndarray
    p: np.ndarray
    ratio: np.ndarray
    anchors: np.ndarray


@dataclass(frozen=True)
class Structure:
    """A model's constant matrices, in the article's notation.

    weight (3, n): gravity at the nodes, N; lever (B, n): how a bar's nodes move when its vector changes about its
    centre or pin; in_plane (3, 1): 1 on the axes that the scene uses;
    honeycombs: (string, NSH) of the strings that have one;
    breakpoints: per string the ends of its pieces, m.
    """

    model: Model
    C_s: np.ndarray
    C_b: np.ndarray
    J: np.ndarray
    M: np.ndarray
    M_inv: np.ndarray
    ground: Ground
    weight: np.ndarray
    lever: np.ndarray
    in_plane: np.ndarray
    honeycombs: tuple
    breakpoints: tuple


def structure(model: Model) -> Structure:
    """Work out the constant matrices.  Raises InputError for a model that is not class 1 or not well posed."""
    n = len(model.nodes)
    bar_of = _bar_of_node(model)
    C_s, C_b = connectivity(model.strings, n), connectivity(model.bars, n)
    C_r = 0.5 * np.abs(C_b)
    J = model.bar_mass / 12.0
    M = mass_matrix(C_b, C_r, J, model.bar_mass)
    on_bar = np.flatnonzero(bar_of >= 0)
    M_inv = np.zeros((n, n))    # anchors have no mass and no acceleration
    M_inv[np.ix_(on_bar, on_bar)] = np.linalg.inv(M[np.ix_(on_bar, on_bar)])

    pins = np.flatnonzero(model.fixed & (bar_of >= 0))
    pin_bars = bar_of[pins]
    lever = 0.5 * C_b
    lever[pin_bars] = C_b[pin_bars]
    lever[pin_bars, pins] = 0.0
    p, q = M_inv[pins, pins], 0.5 * C_b[pin_bars, pins] * (C_b @ M_inv)[pin_bars, pins]
    ground = Ground(M_inv[:, pins], (C_b @ M_inv)[:, pins], np.eye(len(model.bars))[:, pin_bars], np.eye(n)[pins],
                    p, q / (p - q), (model.fixed & (bar_of < 0)).astype(float))

    in_plane = np.zeros((3, 1))
    in_plane[list(model.axes)] = 1.0
    weight = np.zeros((3, n))
    weight[2] = -model.gravity * model.bar_mass @ C_r
    honeycombs = tuple((j, nsh) for j, nsh in enumerate(model.nsh) if nsh is not None)
    ends = tuple((0.0,) if nsh is None else tuple(honeycomb.breakpoints(nsh).tolist()) for nsh in model.nsh)
    return Structure(model, C_s, C_b, J, M, M_inv, ground, weight, lever, in_plane, honeycombs, ends)


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
    if model.damping_law not in ("literal", "tension_only"):
        raise InputError(f"damping_law = {model.damping_law!r}: use 'literal' or 'tension_only'")
    return bar_of


# ------------------------------------------------------------------------------------------------- one instant in time

class Load(NamedTuple):
    """Inputs of one step: force (3, n) N; rest_length (S,) m at `since` (s), moving with rest_length_rate (S,) m/s."""

    since: float
    force: np.ndarray
    rest_length: np.ndarray
    rest_length_rate: np.ndarray


class Mode(NamedTuple):
    """Per string: the piece of the force curve that it follows; whether its tension is clipped at zero; the
    elongations (m) at which the piece begins and ends; taut and pulls: 1 where it is not slack, not clipped, else 0."""

    piece: np.ndarray
    clipped: np.ndarray
    taut: np.ndarray
    pulls: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


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
    """Everything that follows from a state: strings, lambda (B,), ground's forces (3, n), Xdot (3, 2n)."""

    strings: Strings
    lam: np.ndarray
    ground: np.ndarray
    Xdot: np.ndarray


def strings_at(s: Structure, load: Load, mode: Mode, t: float, N, Ndot) -> Strings:
    """Kinematics and tensions of all strings under the pieces that `mode` holds."""
    S, xi, xi_rate = string_motion(N, Ndot, s.C_s)
    stretch = xi - (load.rest_length + load.rest_length_rate * (t - load.since))
    rate = xi_rate - load.rest_length_rate
    elastic = elastic_tension(stretch, mode.taut, mode.piece, s.model.stiffness, s.honeycombs)
    unclipped = elastic + damping_tension(rate, mode.taut, s.model.damping)
    return Strings(S, xi, stretch, rate, elastic, unclipped, unclipped * mode.pulls)


def motion_at(s: Structure, load: Load, mode: Mode, t: float, N, Ndot) -> Motion:
    """Equation 1 and its first order form at one instant."""
    strings = strings_at(s, load, mode, t, N, Ndot)
    density = strings.tension / strings.xi
    B, Bdot = N @ s.C_b.T, Ndot @ s.C_b.T
    inertial = s.J * diagonal(Bdot, Bdot)
    W = load.force + s.weight
    F = W - (strings.S * density) @ s.C_s
    lam = bar_force_density(B, inertial, F, s.C_b)
    ground = constraint_forces(B, lam, F, s.ground)
    lam = bar_force_density(B, inertial, F + ground, s.C_b)
    K = stiffness_matrix(density, lam, s.C_s, s.C_b)
    return Motion(strings, lam, ground, first_order_form(N, Ndot, K, W + ground, s.M_inv))


def powers(load: Load, strings: Strings, Ndot) -> tuple[float, float, float]:
    """Input power, dissipated power, and the sum of the absolute values of their terms (a term per node's force, per
    string's moving rest length, and per string's damper), W."""
    put_in = np.concatenate((diagonal(load.force, Ndot), -strings.tension * load.rest_length_rate))
    lost = (strings.tension - strings.elastic) * strings.rate
    total = np.add.reduce
    return total(put_in), total(lost), total(np.abs(put_in)) + total(np.abs(lost))


def elastic_energy(s: Structure, stretch) -> float:
    """Energy stored in the strings, J."""
    k, carriers = s.model.stiffness, dict(s.honeycombs)
    return sum(honeycomb.energy(carriers[j], x, k[j]) if j in carriers else 0.5 * k[j] * max(x, 0.0) ** 2
               for j, x in enumerate(stretch.tolist()))


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
    """Upper bound on how fast the dampers slow the nodes down, 1/s: largest eigenvalue of C_s^T d C_s M^-1."""
    damping = (s.C_s.T * s.model.damping) @ s.C_s
    return float(np.abs(np.linalg.eigvals(damping @ s.M_inv)).max(initial=0.0))


def mode_of(s: Structure, piece: np.ndarray, clipped: np.ndarray) -> Mode:
    """A mode from its pieces and clips."""
    lower, upper = np.full(len(piece), -np.inf), np.full(len(piece), np.inf)
    for j, (p, ends) in enumerate(zip(piece.tolist(), s.breakpoints)):
        if p > 0:
            lower[j] = ends[p - 1]
        if p < len(ends):
            upper[j] = ends[p]
    return Mode(piece, clipped, (piece > 0).astype(float), (~clipped).astype(float), lower, upper)


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


# ------------------------------------------------------------------------------------------------------ the integration

class _Watch(NamedTuple):
    """What decides on transitions at one instant: `gaps` and their rates (both (3, S))."""

    gap: np.ndarray
    rate: np.ndarray


class _Due(NamedTuple):
    """A transition found within a step: when (s), which gap closes (row of `gaps`), for which string."""

    time: float
    row: int
    string: int


class _Run:
    """One simulation.  State y: [N Ndot] of the free nodes (3, 2F), row by row; input work, dissipated, throughput."""

    def __init__(self, model: Model, inputs: Inputs, rtol: float, atol: float, method: str):
        self.s = structure(model)
        self.method = METHODS[("Radau" if fastest_rate(self.s) > STIFF else "DOP853") if method == "auto" else method]
        self.inputs, self.rtol = inputs, rtol * self.method.scale
        self.free = model.free_nodes
        n, self.moving = len(model.nodes), 6 * len(self.free)
        self.X_fixed = np.concatenate((np.where(model.fixed, model.nodes.T, 0.0), np.zeros((3, n))), axis=1)
        self.select = np.eye(2 * n)[np.concatenate((self.free, n + self.free))]
        # The throughput only scales the ledger; the corners of its absolute values must not govern the step.
        of_node = np.repeat([1.0, self.method.velocity], len(self.free)) * atol * self.method.scale
        self.atol = np.concatenate((np.tile(of_node, 3), [LEDGER_ATOL, LEDGER_ATOL, np.inf]))
        self.rows: list[dict] = []
        self.transitions: list[Transition] = []
        self.stats = {"evaluations": 0, "steps": 0, "restarts": 0}
        self.step_hint = FIRST_STEP
        self.steps_since_row = 0
        self.load = self._load(0)

    # State and right-hand side.

    def unpack(self, y):
        """N, Ndot (3, n) from y."""
        X = self.X_fixed + y[:self.moving].reshape(3, -1) @ self.select
        n = X.shape[1] // 2
        return X[:, :n], X[:, n:]

    def pack(self, N, Ndot, integrals):
        """y from N, Ndot (3, n) and the three integrals."""
        return np.concatenate((np.concatenate((N[:, self.free], Ndot[:, self.free]), axis=1).ravel(), integrals))

    def projected(self, y):
        """y with N and Ndot on the bars' constraints."""
        return self.pack(*on_constraints(self.s, *self.unpack(y)), y[-3:])

    def derivative(self, mode: Mode):
        """The right-hand side ydot(t, y) under one mode: eq. 7 and the powers of the energy ledger."""
        load, moving = self.load, self.select.T

        def ydot(t, y):
            self.stats["evaluations"] += 1
            N, Ndot = self.unpack(y)
            motion = motion_at(self.s, load, mode, t, N, Ndot)
            return np.concatenate(((motion.Xdot @ moving).ravel(), powers(load, motion.strings, Ndot)))
        return ydot

    def jacobian(self, ydot):
        """d ydot / dy by differences.  SciPy's own, over 1e-16 m/s where a velocity is zero, drown in round-off."""
        def jac(t, y):
            J, at_y = np.zeros((len(y), len(y))), ydot(t, y)
            for i in range(self.moving):    # nothing depends on the integrals
                moved = y.copy()
                moved[i] += DIFFERENCE
                J[:, i] = (ydot(t, moved) - at_y) / DIFFERENCE
            return J
        return jac

    def strings(self, t, y, mode: Mode) -> Strings:
        """The strings at y."""
        return strings_at(self.s, self.load, mode, t, *self.unpack(y))

    def stretch_acceleration(self, t, y, mode: Mode):
        """(S,) m/s2: second derivative of xi - xi0."""
        N, Ndot = self.unpack(y)
        S, xi, xi_rate = string_motion(N, Ndot, self.s.C_s)
        Sdot = Ndot @ self.s.C_s.T
        Sddot = motion_at(self.s, self.load, mode, t, N, Ndot).Xdot[:, N.shape[1]:] @ self.s.C_s.T
        return (diagonal(Sdot, Sdot) + diagonal(S, Sddot) - xi_rate ** 2) / xi

    # Inputs.

    def _load(self, k: int) -> Load:
        i = self.inputs
        return Load(float(i.times[k]), i.force[k].T * self.s.in_plane, i.rest_length[k], i.rest_length_rate[k])

    def _changes(self, k: int) -> bool:
        """Whether step k's inputs are other than those of step k-1 carried on."""
        i = self.inputs
        carried = i.rest_length[k - 1] + i.rest_length_rate[k - 1] * (i.times[k] - i.times[k - 1])
        return not (np.array_equal(i.force[k], i.force[k - 1]) and np.array_equal(i.rest_length[k], carried)
                    and np.array_equal(i.rest_length_rate[k], i.rest_length_rate[k - 1]))

    def _change_inputs(self, k: int, y, mode: Mode):
        """Take over the inputs of step k.  A jump of a rest length does work, but gives no impulse."""
        t = float(self.inputs.times[k])
        before = elastic_energy(self.s, self.strings(t, y, mode).stretch)
        self.load = self._load(k)
        jump = elastic_energy(self.s, self.strings(t, y, mode).stretch) - before
        settled = self._settled(t, y, mode)
        self._note(t, mode, settled)
        return y + np.concatenate((np.zeros(self.moving), [jump, 0.0, abs(jump)])), settled

    # The loop.

    def go(self) -> None:
        """Run through all inputs."""
        times, model = self.inputs.times.tolist(), self.s.model
        y = self.projected(self.pack(model.nodes.T, model.velocity.T, np.zeros(3)))
        slack = np.zeros(len(model.strings), dtype=int)
        mode = self._settled(times[0], y, mode_of(self.s, slack, slack > 0))
        self._record(times[0], y, mode)
        first = 0
        while True:
            last = first + 1
            while self.method.dense and last < len(times) - 1 and not self._changes(last):
                last += 1
            y, mode = self._hold_inputs(y, mode, times[first], times[first + 1:last + 1])
            if last == len(times) - 1:
                return
            if self._changes(last):
                y, mode = self._change_inputs(last, y, mode)
            first = last

    def _hold_inputs(self, y, mode: Mode, t: float, rows: list[float]):
        """Integrate to rows[-1] under one load and record the rows; returns the state and mode there."""
        end, pending, stalled = rows[-1], rows[::-1], 0
        while t < end:
            t_before = t
            t, y, due = self._smooth_stretch(mode, t, y, end, pending)
            self.stats["restarts"] += 1
            if due is not None:
                changed = self._after(mode, t, y, due)
                self._note(t, mode, changed)
                mode = changed
                stalled = stalled + 1 if t == t_before else 0
                if stalled > MAX_STALLED:
                    name = self.s.model.string_names[due.string]
                    raise SimulationError("chattering", f"string {name!r} changes its piece without end; "
                                          "look at the inputs just before", float(t))
        while pending:    # a transition fell on the last row
            self._record(pending.pop(), y, mode)
        return y, mode

    def _smooth_stretch(self, mode: Mode, t: float, y, end: float, pending: list[float]):
        """Integrate under one mode until the end, a transition, or too much drift.

        Records the rows on the way (popped from pending, which is in falling order).
        Returns time, state on the constraints, and the transition due or None.
        """
        solver = self._solver(mode, t, y, end, self.step_hint)
        watch = self._watch(mode, t, y)
        while solver.status == "running":
            t, y, proposed = solver.t, solver.y, solver.h_abs
            self._step(solver)
            watch_before, watch = watch, self._watch(mode, solver.t, solver.y)
            self.step_hint = max(solver.h_abs, proposed) if solver.t == end else solver.h_abs
            due = self._first_due(mode, t, watch_before, solver, watch)
            if due is not None:
                return self._land(mode, t, y, due, pending)
            self._record_rows(pending, [solver.dense_output()] if self._has_row(pending, solver.t) else [],
                              solver.t, solver.y, mode)
            deviation = drift(self.s, *self.unpack(solver.y))
            if not deviation <= BROKEN:
                raise self._failure(solver.t, f"a bar's length or rate has gone wrong by {deviation!r}")
            if deviation > DRIFT:
                break
        return solver.t, self.projected(solver.y), None

    def _land(self, mode: Mode, t: float, y, due: _Due, pending: list[float]):
        """Repeat the step from t, y so that it ends at the transition: Newton steps on its instant."""
        if due.time <= t:
            return t, self.projected(y), due
        at = due.time
        for _ in range(8):
            solver, dense = self._solver(mode, t, y, at, at - t), []
            while solver.status == "running":
                self._step(solver)
                if self._has_row(pending, at):
                    dense.append(solver.dense_output())
            landed = self.projected(solver.y)
            watch = self._watch(mode, at, landed)
            gap, rate = watch.gap[due.row, due.string], watch.rate[due.row, due.string]
            better = at - gap / rate if rate < 0.0 else at
            if abs(gap) <= ROUND_OFF[due.row] or better == at or not t < better <= at + 0.1 * (at - t):
                break
            at = better
        self._record_rows(pending, dense, at, solver.y, mode)
        return at, landed, due

    def _solver(self, mode: Mode, t: float, y, end: float, first_step: float):
        ydot = self.derivative(mode)
        if not np.isfinite(ydot(t, y)).all():
            raise self._failure(t, "a force is not finite")
        implicit = {"jac": self.jacobian(ydot)} if self.method.implicit else {}
        return self.method.solver(ydot, t, y, end, rtol=self.rtol, atol=self.atol, first_step=min(first_step, end - t),
                                  **implicit)

    def _step(self, solver) -> None:
        t = solver.t
        try:
            message = solver.step()
        except ValueError as failure:    # Radau's linear algebra refuses what is not finite
            raise self._failure(t, str(failure)) from failure
        self.stats["steps"] += 1
        self.steps_since_row += 1
        if self.steps_since_row > MAX_STEPS:
            raise self._failure(t, f"{MAX_STEPS} steps did not reach the next row")
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise self._failure(t, message or "a value is not finite")

    @staticmethod
    def _failure(t: float, why: str) -> SimulationError:
        return SimulationError("step_failed", f"SciPy cannot go on ({why}); look for a string whose ends meet, "
                               "or for an excessive input or parameter", float(t))

    # Transitions.

    def _watch(self, mode: Mode, t: float, y) -> _Watch:
        """Gaps and their rates; that of a clip by a one-sided difference along the motion."""
        strings = self.strings(t, y, mode)
        rate = np.stack((strings.rate, -strings.rate, np.zeros_like(strings.rate)))
        if self.s.model.damping_law == "tension_only":
            dt = 1e-8
            ahead = self.strings(t + dt, y + dt * self.derivative(mode)(t, y), mode).unclipped
            rate[2] = np.where(mode.clipped, -1.0, 1.0) * (ahead - strings.unclipped) / dt
        return _Watch(gaps(self.s, mode, strings), rate)

    def _first_due(self, mode: Mode, t: float, before: _Watch, solver, after: _Watch) -> _Due | None:
        """The first transition within the solver's last step, which began at t; None if there is none."""
        h = solver.t - t
        crossed = after.gap < -ROUND_OFF[:, None]
        turned = ~crossed & (before.rate < 0.0) & (after.rate > 0.0) & np.isfinite(after.gap)
        if turned.any():
            # The tangents at both ends meet below the lowest point; only if that is negative can the gap have closed.
            before_gap, after_gap = before.gap[turned], after.gap[turned]
            meet = (after_gap - before_gap - after.rate[turned] * h) / (before.rate[turned] - after.rate[turned])
            turned[turned] = before_gap + before.rate[turned] * meet < 0.0
        if not (crossed.any() or turned.any()):
            return None
        dense = solver.dense_output()
        times = np.linspace(t, solver.t, SAMPLES + 1)
        samples = np.array([gaps(self.s, mode, self.strings(at, dense(at), mode)) for at in times])
        found = []
        for row, string in np.argwhere(crossed | turned):
            def gap(at):
                return gaps(self.s, mode, self.strings(at, dense(at), mode))[row, string]
            at = _first_root(gap, times, samples[:, row, string], -ROUND_OFF[row])
            if at is not None:
                found.append(_Due(at, int(row), int(string)))
        return min(found, default=None)

    def _after(self, mode: Mode, t: float, y, due: _Due) -> Mode:
        """The mode after a transition; strings that reach the end of their piece at the same instant change with it."""
        watch = self._watch(mode, t, y)
        change = (watch.gap <= TOGETHER[:, None]) & (watch.rate < 0.0)
        change[due.row, due.string] = True
        piece = mode.piece - change[0] + change[1]
        return mode_of(self.s, piece, (mode.clipped ^ change[2]) & (piece > 0))

    def _settled(self, t: float, y, mode: Mode) -> Mode:
        """The mode at the start, or after a change of inputs.

        A string inside its piece keeps it.  At the end of a piece it goes where its rate leads, or its acceleration
        if it is at rest: at xi = xi0 it is taut only if it lengthens.
        """
        strings = self.strings(t, y, mode)
        near = TOGETHER[0]
        inside = (strings.stretch > mode.lower + near) & (strings.stretch < mode.upper - near)
        if not inside.all():
            down = np.array([np.searchsorted(e, x - near) for e, x in zip(self.s.breakpoints, strings.stretch)])
            up = np.array([np.searchsorted(e, x + near) for e, x in zip(self.s.breakpoints, strings.stretch)])
            leads, unclipped = strings.rate, mode.clipped & inside
            resting = (np.abs(strings.rate) < AT_REST) & (up > down)
            if resting.any():
                lowest = mode_of(self.s, np.where(inside, mode.piece, down), unclipped)
                leads = np.where(resting, self.stretch_acceleration(t, y, lowest), leads)
            mode = mode_of(self.s, np.where(inside, mode.piece, np.where(leads > 0.0, up, down)), unclipped)
        if self.s.model.damping_law == "tension_only":
            tension = self.strings(t, y, mode).unclipped
            clipped = np.where(np.abs(tension) <= TOGETHER[2], mode.clipped, tension < 0.0)
            mode = mode_of(self.s, mode.piece, clipped & (mode.piece > 0))
        return mode

    def _note(self, t: float, before: Mode, after: Mode) -> None:
        for j in np.flatnonzero(before.piece != after.piece):
            self.transitions.append(Transition(float(t), int(j), int(before.piece[j]), int(after.piece[j])))

    # Rows of the result.

    @staticmethod
    def _has_row(pending: list[float], t: float) -> bool:
        return bool(pending) and pending[-1] < t

    def _record_rows(self, pending: list[float], dense: list, t: float, y, mode: Mode) -> None:
        """Record the rows up to t, where the state is y; rows before t from the dense outputs that lead there."""
        while pending and pending[-1] <= t:
            row = pending.pop()
            state = y if row == t else next(d for d in dense if row <= d.t)(row)
            self._record(row, self.projected(state), mode)

    def _record(self, t: float, y, mode: Mode) -> None:
        s, model = self.s, self.s.model
        self.steps_since_row = 0
        N, Ndot = self.unpack(y)
        motion = motion_at(s, self.load, mode, t, N, Ndot)
        strings = motion.strings
        self.rows.append(dict(
            position=N.T, velocity=Ndot.T, string_force=strings.tension, elastic_force=strings.elastic,
            string_length=strings.xi, bar_force=-motion.lam * model.bar_length, reaction=motion.ground.T,
            kinetic=0.5 * np.trace(Ndot @ s.M @ Ndot.T), potential=-np.sum(s.weight * N),
            elastic=elastic_energy(s, strings.stretch), input_work=y[-3], dissipated=y[-2], throughput=y[-1],
            snapped=[honeycomb.snapped_on_piece(nsh, mode.piece[j]) for j, nsh in s.honeycombs]))


def _first_root(gap, times: np.ndarray, values: np.ndarray, level: float) -> float | None:
    """First instant at which gap(t) falls through zero; None if it stays above `level`.

    values: gap at times.  A start at or below zero counts as zero unless the gap opens first.
    """
    below = np.flatnonzero(values[1:] < level) + 1
    if len(below):
        low, high = times[below[0] - 1], times[below[0]]
    else:
        k = int(np.argmin(values))
        low, high = times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)]
        lowest = minimize_scalar(gap, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * (high - low)})
        if lowest.fun >= level:
            return None
        high = float(lowest.x)
    for _ in range(60):
        if gap(low) > 0.0:
            return float(brentq(gap, low, high, xtol=1e-300, rtol=1e-15))
        if low > times[0]:
            return float(low)
        # The gap is closed at the start: has it opened since?
        high_half = 0.5 * (times[0] + high)
        if gap(high_half) > 0.0:
            low = high_half
        else:
            high = high_half
    return float(times[0])


def simulate(model: Model, inputs: Inputs, rtol: float = 1e-10, atol: float = 1e-11, method: str = "auto") -> Result:
    """Simulate a class-1 tensegrity under held inputs; see Result for what comes back.

    rtol, atol (m): SciPy's tolerances per step, adapted to the method as METHODS says; method: 'auto' (Radau where the
    dampers make the equations stiff, else DOP853) or a name in METHODS.  With the defaults the article's three-bar
    scene under +-400 N, d = 50, 500, 5000 N s/m, is good to 1e-9 m after 5 s.
    throughput adds up |F . v| per node, |T dxi0/dt| and |(T - f_s) d(xi - xi0)/dt| per string, and the absolute values
    of jumps of stored energy.
    Raises InputError for a model or inputs outside the equations' range, SimulationError where the run cannot go on.
    """
    if method not in ("auto", *METHODS):
        raise InputError(f"method = {method!r}: use 'auto' or one of {', '.join(METHODS)}")
    _check_inputs(model, inputs)
    run = _Run(model, inputs, rtol, atol, method)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):    # every step is checked to be finite
        run.go()
    series = {name: np.array([row[name] for row in run.rows]) for name in run.rows[0]}
    series["snapped"] = series["snapped"].reshape(len(run.rows), -1).astype(int)
    return Result(times=np.array(inputs.times, dtype=float), transitions=run.transitions,
                  stats={k: float(v) for k, v in run.stats.items()}, **series)


def _check_inputs(model: Model, inputs: Inputs) -> None:
    steps, n, strings = len(inputs.times) - 1, len(model.nodes), len(model.strings)
    shapes = {"force": (steps, n, 3), "rest_length": (steps, strings), "rest_length_rate": (steps, strings)}
    if steps < 1 or not (np.diff(inputs.times) > 0.0).all():
        raise InputError(f"times = {inputs.times!r}: give at least two increasing times")
    for name, shape in shapes.items():
        value = getattr(inputs, name)
        if value.shape != shape:
            raise InputError(f"{name} has shape {value.shape}; this model and these times need {shape}")
        if not np.isfinite(value).all():
            raise InputError(f"{name} holds a value that is not finite; use finite numbers")
    if (inputs.rest_length < 0.0).any():
        least = float(inputs.rest_length.min())
        raise InputError(f"rest_length = {least!r} m: a rest length cannot be negative; use >= 0")
