"""A structure's motion about one state as a linear system: x' = f + A x + B u, y = C x + D u, all of them deviations.

The r coordinates y turn every bar about its fixed end or its middle, shift the middles of free bars, and move nodes on no bar;
bars keep their lengths to all orders: a bar's vector is b(y) = l (e + E y / l) / |e + E y / l|, with columns E across e.  At
the state, with dots for products over a bar's own coordinates and Delta = E,

    b_y = Delta,   b_yy[y, w] = -b (Delta y . Delta w)/l2,
    b_yyy[y, w, w] = -(Delta y |Delta w|2 + 2 Delta w (Delta y . Delta w))/l2.

Nodes are x = Phi y + P p there, with p the positions of moved nodes, and eq. 1 projected on Phi does without the bars' forces:
Phi^T (M x'' - F) = 0.  Its derivative has, beside those of M x'' and F, the turning of Phi under the bars' forces.
F has the strings' tensions T: dT = k (dxi - dxi0) + d (dxi' - dxi0'), so that a rest length and its rate are two inputs.  An
actuator adds its angle: J delta'' = k_a i - d_a delta' - r (T + load), xi0 = xi0(0) - r delta.

All derivatives are rows over the columns z = [y, delta, y', delta', inputs].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import InputError
from ..fields import FIELDS, Field, size
from ..laws import damping, string_law
from ..model import Model
from ..model.components import flattened, named, names
from ..model.inputs import INPUTS, starts
from ..model.routes import segments
from ..model.strength import bar_utilisation, buckling_load, string_utilisation

KINK = 1e-9  # m: a string is at an end of its piece
SIDES = {"longer": 1.0, "shorter": -1.0}
LENGTHS = 1e-6  # relative: how far a state may be off the bars' lengths
#: The outputs that have a linear part here: energies are quadratic about rest, and counts jump.
OUTPUTS = tuple(field for field in FIELDS if field.role == "output" and field.unit != "J")


class State(NamedTuple):
    """Where a motion is linearised.  nodes: (N, 3) m; velocity: (N, 3) m/s; speed: (A,) rad/s of the actuators; inputs: name
    of the field -> values at one instant, see `model.inputs`; rest lengths of strings with an actuator are those wound."""

    nodes: np.ndarray
    velocity: np.ndarray
    speed: np.ndarray
    inputs: dict[str, np.ndarray]


class Quantity(NamedTuple):
    """A state, an input or an output: its name, its unit, and its value where the motion is linearised."""

    name: str
    unit: str
    value: float


@dataclass(frozen=True, eq=False)
class Linear:
    """x' = drift + A x + B u, y = C x + D u, all of them deviations from an operating point.

    A (n, n), B (n, inputs), C (outputs, n), D (outputs, inputs); states, inputs, outputs: their names, units, and values at the
    operating point; drift: (n,) x' there, 0 at an equilibrium; strings: what each string is on: 'slack', 'taut', or how many of
    its parts are snapped.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    drift: np.ndarray
    strings: dict[str, str]


def at_rest(model: Model, force=None) -> State:
    """The model's start under forces (N, 3), N; actuators hold their strings' tensions there."""
    given = starts(model)
    given["node_velocity"] = np.zeros_like(given["node_velocity"])
    if force is not None:
        given["force"] = np.asarray(force, dtype=float)
    tension = statics.string_tension(model, model.string_lengths(model.nodes))
    radius = np.array([motor.radius for motor in model.motors.values()])
    constant = np.array([motor.torque_constant for motor in model.motors.values()])
    if len(radius):
        given["current"] = radius * (tension[list(model.actuated)] + given["drum_load"]) / constant
    return State(model.nodes, np.zeros_like(model.nodes), np.zeros(len(radius)), given)


def linearize(model: Model, state: State, side: str | None = None) -> Linear:
    """The linear system of a model about a state.  side: of a string that stands at an end of its piece, 'longer' or 'shorter':
    which of its two derivatives.

    Raises InputError where a string has two and none is chosen, and for a state that is not on the bars' lengths; TooLarge.
    """
    statics.require_small(model, "linearising it")
    if model.ground is not None:
        raise InputError(f"{model.name}: it stands on the ground, which linearising does not know yet; leave [ground] out")
    if side is not None and side not in SIDES:
        raise InputError(f"side = {side!r} is not known; use {' or '.join(SIDES)}")
    from .jointed import JointedSystem  # which is made of what stands here

    kind = JointedSystem if model.joint else System
    return kind(replace(model, nodes=state.nodes), state, _Strings(model, state, side)).linear()


class _Strings:
    """Tensions and their derivatives at a state.

    length (m), tension and elastic (N): (S,); k (N/m), d (N s/m): (S,), derivatives of
    the tension by elongation and rate; k_elastic: (S,) N/m, of the elastic tension; growth (S, n): of the lengths by the nodes'
    coordinates; growth_rate (S, n), 1/s: of their rates; turning (n, n), N/m: of the forces, at constant tensions.
    branch: name -> what a string is on.
    """

    def __init__(self, model: Model, state: State, side: str | None):
        axes, count, n = list(model.axes), len(model.strings), len(model.nodes)
        x, v = state.nodes[:, axes], state.velocity[:, axes]
        string, ends = segments(model.paths)
        each = np.arange(len(ends))
        incidence, whole = np.zeros((len(ends), n)), np.zeros((count, len(ends)))  # whole: a string is its segments
        incidence[each, ends[:, 0]], incidence[each, ends[:, 1]], whole[string, each] = -1.0, 1.0, 1.0
        s, sdot = incidence @ x, incidence @ v
        lengths = np.linalg.norm(s, axis=1)
        over = 1.0 / np.maximum(lengths, 1e-300)
        u = s * over[:, None]
        self.length = whole @ lengths
        rate = whole @ (u * sdot).sum(1) - _on_drums(model, state)
        self._laws(model, self.length - state.inputs["rest_length"], rate, side)
        across = np.eye(len(axes)) - u[:, :, None] * u[:, None]
        turned = np.einsum("sd,sde->se", sdot, across) * over[:, None]
        self.growth, self.growth_rate = (
            whole @ np.einsum("sn,sd->snd", incidence, a).reshape(len(ends), n * len(axes)) for a in (u, turned)
        )
        blocks = across * (self.tension[string] * over)[:, None, None]
        self.turning = np.einsum("sn,sde,sm->ndme", incidence, blocks, incidence).reshape((n * len(axes),) * 2)

    def _laws(self, model: Model, elongation: np.ndarray, rate: np.ndarray, side: str | None) -> None:
        self.elastic, self.tension, self.k, self.d = np.zeros((4, len(elongation)))
        self.branch: dict[str, str] = {}
        for j, (x, by) in enumerate(zip(elongation.tolist(), rate.tolist())):
            name, d = model.string_names[j], model.damping.item(j)
            damper = model.damper[j]
            slope, force = (d, d * by) if damper is None else (damping(damper).slope(by), damping(damper).force(by))
            if model.two_way[j]:  # k (xi - xi0) at any length
                self.k[j], self.d[j], self.elastic[j] = model.stiffness[j], slope, model.stiffness[j] * x
                self.tension[j], self.branch[name] = self.elastic[j] + force, "taut"
                continue
            law = string_law(model, j).follow(max(x, 0.0))
            sides = [(law.stiffness(at), d) if at > 0.0 else (0.0, 0.0) for at in (x - 2.0 * KINK, x + 2.0 * KINK)]
            ends = (0.0, *law.breakpoints, *(getattr(law, end, 0.0) for end in ("lower", "upper")))  # the latter with memory
            kinked = min(abs(x - end) for end in ends) <= 2.0 * KINK and any(
                abs(a - b) > 1e-4 * max(abs(a), abs(b)) for a, b in zip(*sides)
            )
            if kinked and side is None:
                raise InputError(
                    f"{name} stands at an end of its piece, where its tension has two derivatives ({sides[0][0]:.6g} and "
                    f"{sides[1][0]:.6g} N/m); choose one: side 'longer' or 'shorter', or change the load a little"
                )
            at = x + 2.0 * KINK * SIDES[side] if kinked and side is not None else x
            if at <= 0.0:
                self.branch[name] = "slack"
                continue
            self.elastic[j], self.tension[j] = law.force(max(x, 0.0)), law.force(max(x, 0.0)) + force
            self.k[j], self.d[j] = law.stiffness(at), slope
            self.branch[name] = _on(law, at)
        self.k_elastic = self.k.copy()
        if model.damping_law == "tension_only":
            pulls = (self.tension >= 0.0) | model.two_way
            for j in np.flatnonzero(~pulls).tolist():
                self.branch[model.string_names[j]] += ", clipped: its damper would push"
            self.tension, self.k, self.d = self.tension * pulls, self.k * pulls, self.d * pulls


def _on(law, elongation: float) -> str:
    """Words for the piece of a law that an elongation (m) is on."""
    snapped = getattr(law, "snapped", None)
    if snapped is None:
        snapped = law.snapped_on_piece(int(np.searchsorted(law.breakpoints, elongation)))
    return f"{snapped} snapped" if snapped else "taut"


def _on_drums(model: Model, state: State) -> np.ndarray:
    """(S,) m/s: rates of the rest lengths, of those that an actuator winds too."""
    rate = state.inputs["rest_length_rate"].copy()
    for motor, (j, actuator) in enumerate(model.motors.items()):
        rate[j] = -actuator.radius * state.speed[motor]
    return rate


class System:
    """The derivatives of everything over the columns z."""

    def __init__(self, model: Model, state: State, strings: _Strings):
        self.model, self.state, self.strings = model, state, strings
        self.axes = list(model.axes)
        self.x, self.v = (values[:, self.axes].ravel() for values in (state.nodes, state.velocity))
        self._coordinates()
        self._columns()
        self._bars()
        self._masses()

    def _coordinates(self) -> None:
        """phi (n, r), its columns turns, shifts of middles, and nodes on no bar; moved (n, E D): P."""
        model, D = self.model, len(self.axes)
        balance = statics.Balance(model)
        basis = balance.basis(balance.shape(statics.free_rows(model, model.nodes)))
        afloat = ~model.fixed[model.bars].any(axis=1)
        scale = [*np.repeat(np.where(afloat, np.sqrt(0.5), 1.0), D - 1), *np.full(D * afloat.sum(), np.sqrt(2.0))]
        basis = basis * np.array([*scale, *np.ones(basis.shape[1] - len(scale))])
        self.phi = np.zeros((len(model.nodes), D, basis.shape[1]))
        self.phi[model.free_nodes] = basis.reshape(len(model.free_nodes), D, basis.shape[1])
        self.phi = self.phi.reshape(len(self.x), -1)
        moved = np.zeros((len(model.nodes), D, len(model.moving), D))
        for e, node in enumerate(model.moving):
            carried = {int(end) for bar in model.bars if node in bar for end in bar}
            moved[[node, *carried], :, e] = np.eye(D)
        self.moved = moved.reshape(len(self.x), -1)
        turns = [f"{bar}.across[{i + 1}]" for bar in model.bar_names for i in range(D - 1)]
        middles = [f"{bar}.middle.{'xyz'[a]}" for bar, free in zip(model.bar_names, afloat) if free for a in self.axes]
        self.names = [*turns, *middles, *(f"{model.node_names[i]}.{'xyz'[a]}" for i in model.lone_nodes for a in self.axes)]

    def _columns(self) -> None:
        """Where each group of columns of z begins; inputs: their quantities."""
        model = self.model
        self.inputs: list[Quantity] = []
        fields, self.place = list(INPUTS.items()), {}
        self.r, self.motors = self.phi.shape[1], list(model.motors.values())
        self.n = self.r + len(self.motors)
        for name, field in fields:
            values = flattened(field, model, np.asarray(self.state.inputs[name], dtype=float)[None])[0]
            kept = [j for j in named(field, model).values() if field.shape != ("S",) or j not in model.motors]
            self.place[name] = (2 * self.n + len(self.inputs), kept)
            listed = names(field, model)
            self.inputs += [Quantity(listed[j], field.unit, float(values[j])) for j in kept]
        self.width = 2 * self.n + len(self.inputs)

    def _column(self, matrix: np.ndarray, start: int) -> np.ndarray:
        """(rows, columns of z): a matrix from one column on."""
        found = np.zeros((len(matrix), self.width))
        found[:, start : start + matrix.shape[1]] = matrix
        return found

    def _input(self, name: str) -> np.ndarray:
        """(values of the field, columns of z): ones at an input's own."""
        start, kept = self.place[name]
        count = len(names(INPUTS[name], self.model))
        found = np.zeros((count, self.width))
        found[kept, start + np.arange(len(kept))] = 1.0
        return found

    def _bars(self) -> None:
        """levers (B, 2): the ends' places about the bar's fixed end or middle; turn (B, D, r): Delta."""
        model, D = self.model, len(self.axes)
        self._vectors()
        phi = self.phi.reshape(len(model.nodes), D, self.r)
        self.turn = phi[model.bars[:, 1]] - phi[model.bars[:, 0]]
        fixed = model.fixed[model.bars]
        self.lever = np.where(fixed.any(1)[:, None], np.where(fixed, 0.0, [[-1.0, 1.0]]), [[-0.5, 0.5]])

    def _vectors(self) -> None:
        """b (B, D) m and l2 (B,) m2.  Raises InputError where the state stretches a bar."""
        model, D = self.model, len(self.axes)
        x, v = (values.reshape(-1, D)[model.bars] for values in (self.x, self.v))
        self.b, bdot = x[:, 1] - x[:, 0], v[:, 1] - v[:, 0]
        self.l2 = (self.b * self.b).sum(1)
        nominal = statics.lengths_between(model.nominal, model.bars)
        off = np.abs(np.sqrt(self.l2) / nominal - 1.0)
        if off.max(initial=0.0) > LENGTHS:
            name = model.bar_names[int(np.argmax(off))]
            raise InputError(f"{name} is off its length by {off.max():.3g} of it; give positions that keep the bars' lengths")
        along = np.abs((self.b * bdot).sum(1)) / self.l2
        if (along > LENGTHS * max(1.0, np.abs(v).max())).any():
            name = model.bar_names[int(np.argmax(along))]
            raise InputError(f"the velocities stretch {name}; give those of a motion that keeps the bars' lengths")

    def _spread(self, of_bars: np.ndarray) -> np.ndarray:
        """(n, k) of the nodes' coordinates, from what the bars' vectors have (B, D, k)."""
        D = len(self.axes)
        found = np.zeros((len(self.x) // D, D, of_bars.shape[2]))
        for end in (0, 1):
            np.add.at(found, self.model.bars[:, end], self.lever[:, end, None, None] * of_bars)
        return found.reshape(len(self.x), -1)

    def _on_bars(self, forces: np.ndarray) -> np.ndarray:
        """(B, D, k): what forces at the nodes (n, k) do at the levers."""
        at = forces.reshape(len(self.model.nodes), len(self.axes), forces.shape[1])[self.model.bars]
        return np.einsum("be,bedk->bdk", self.lever, at)

    def _bent(self, w: np.ndarray) -> np.ndarray:
        """(n, r): x_yy[., w]."""
        along = np.einsum("bd,bdr->br", self.turn @ w, self.turn)
        return self._spread(-self.b[:, :, None] * (along / self.l2[:, None])[:, None])

    def _twice_bent(self, w: np.ndarray) -> np.ndarray:
        """(n, r): x_yyy[., w, w]."""
        t = self.turn @ w
        along = np.einsum("bd,bdr->br", t, self.turn)
        whole = (t * t).sum(1)[:, None, None] * self.turn + 2.0 * t[:, :, None] * along[:, None]
        return self._spread(-whole / self.l2[:, None, None])

    def _bending(self, order: int) -> np.ndarray:
        """(k, columns of z): the coordinates that places bend with, 0, or their rates, 1."""
        return np.eye(self.n, self.width, order * self.n)[: self.r]

    def _whole(self, of_y: np.ndarray, field: str) -> np.ndarray:
        """(k,): of these coordinates what y has (r,), and what a field of the inputs gives."""
        return of_y

    def _masses(self) -> None:
        """mass (n, n) kg, of all nodes."""
        model, D = self.model, len(self.axes)
        mass = np.zeros((len(model.nodes),) * 2)
        for (i, j), m in zip(model.bars, model.bar_mass):
            mass[np.ix_((i, j), (i, j))] += m / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        for node, m in model.payload.items():
            mass[node, node] += m
        for string, *ends, part in model.string_mass_links:
            mass[np.ix_(ends, ends)] += part * model.string_mass[string] / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        self.mass = np.kron(mass, np.eye(D))
        drag = np.zeros(len(model.nodes))
        for node, value in model.drag:
            drag[node] = value
        self.drag = np.repeat(drag, D)
        self.weight = (model.node_mass[:, None] * model.g[self.axes]).ravel()

    def linear(self) -> Linear:
        n = self.n
        at, rows = self._at(), self._rows()
        accelerations = np.vstack([self._turned(at, rows), self._wound(rows)])
        outputs = self._outputs(at, rows, accelerations)
        values = np.concatenate([value for _, value, _ in outputs])
        matrix = np.vstack([matrix for _, _, matrix in outputs])
        listed = [(name, field.unit) for field, _, _ in outputs for name in named(field, self.model)]
        whole = np.vstack([np.eye(n, self.width, n), accelerations])
        motors = [f"{self.model.string_names[j]}.actuator" for j in self.model.actuated]
        states = [Quantity(name, "m", 0.0) for name in self.names] + [Quantity(f"{name}.angle", "rad", 0.0) for name in motors]
        states += [Quantity(f"{name}.rate", "m/s", float(w)) for name, w in zip(self.names, at.w)]
        states += [Quantity(f"{name}.speed", "rad/s", float(w)) for name, w in zip(motors, self.state.speed)]
        drift = np.concatenate([at.w, self.state.speed, at.wdot, at.winding])
        found = tuple(Quantity(name, unit, float(value)) for (name, unit), value in zip(listed, values, strict=True))
        return Linear(
            whole[:, : 2 * n],
            whole[:, 2 * n :],
            matrix[:, : 2 * n],
            matrix[:, 2 * n :],
            tuple(states),
            tuple(self.inputs),
            found,
            drift,
            self.strings.branch,
        )

    def _at(self) -> _At:
        """The motion at the state."""
        given, strings, motors = self.state.inputs, self.strings, self.motors
        axes, count = self.axes, len(self.model.nodes)
        w = self._w()
        force = np.reshape(given["force"][:, axes], (count, -1)).ravel() + self.weight - self.drag * self.v
        force -= strings.growth.T @ strings.tension
        speeds = self._whole(w, "node_velocity")
        given_a = self._bent(speeds) @ speeds + self.moved @ np.reshape(given["node_acceleration"][:, axes], -1)
        self.inertia = self.phi.T @ self.mass @ self.phi
        wdot = np.linalg.solve(self.inertia, self.phi.T @ (force - self.mass @ given_a)) if self.r else np.zeros(0)
        residual = self.mass @ (self.phi @ wdot + given_a) - force
        at_motors = strings.tension[list(self.model.actuated)]
        torque = [
            (m.torque_constant * i - m.damping * s - m.radius * (T + load)) / m.inertia
            for m, i, s, T, load in zip(motors, given["current"], self.state.speed, at_motors, given["drum_load"])
        ]
        return _At(w, wdot, np.array(torque), residual)

    def _rows(self) -> _Rows:
        """The derivatives of kinematics and tensions over z."""
        n, r, strings, model = self.n, self.r, self.strings, self.model
        one = np.eye(n, self.width), np.eye(n, self.width, n)
        w = self._w()
        x = self.phi @ one[0][:r] + self.moved @ self._input("node_position")
        v = self.phi @ one[1][:r] + self._bent(self._whole(w, "node_velocity")) @ self._bending(0)
        v += self.moved @ self._input("node_velocity")
        rest, rest_rate = self._input("rest_length"), self._input("rest_length_rate")
        for motor, (j, actuator) in enumerate(model.motors.items()):
            rest[j], rest_rate[j] = -actuator.radius * one[0][r + motor], -actuator.radius * one[1][r + motor]
        length = strings.growth @ x
        elongation, rate = length - rest, strings.growth @ v + strings.growth_rate @ x - rest_rate
        tension = strings.k[:, None] * elongation + strings.d[:, None] * rate
        force = self._forces() - self.drag[:, None] * v - strings.growth.T @ tension - strings.turning @ x
        return _Rows(x, v, length, rest, rest_rate, strings.k_elastic[:, None] * elongation, tension, force)

    def _w(self) -> np.ndarray:
        """(r,) y'."""
        base = self.moved @ np.reshape(self.state.inputs["node_velocity"][:, self.axes], -1)
        return np.linalg.lstsq(self.phi, self.v - base, rcond=None)[0]

    def _forces(self) -> np.ndarray:
        """(n, columns of z): the external forces at the free nodes."""
        D = len(self.axes)
        found = np.zeros((len(self.model.nodes), D, self.width))
        found[self.model.free_nodes] = self._input("force").reshape(-1, D, self.width)
        return found.reshape(len(self.x), -1)

    def _given(self, at: _At) -> np.ndarray:
        """(n, columns of z): the derivatives of x'' but for those of y''."""
        speeds, rates = self._whole(at.w, "node_velocity"), self._whole(at.wdot, "node_acceleration")
        found = (self._bent(rates) + self._twice_bent(speeds)) @ self._bending(0) + 2.0 * self._bent(speeds) @ self._bending(1)
        return found + self.moved @ self._input("node_acceleration")

    def _turned(self, at: _At, rows: _Rows) -> np.ndarray:
        """(r, columns of z): y''."""
        right = self.phi.T @ (rows.force - self.mass @ self._given(at)) - self._tilted(at)
        return np.linalg.solve(self.inertia, right) if self.r else right

    def _tilted(self, at: _At) -> np.ndarray:
        """(r, columns of z): what the bars' forces do along Phi as it turns."""
        pulls = -(self.b * self._on_bars(at.residual[:, None])[:, :, 0]).sum(1) / self.l2  # force densities, tension positive
        return np.einsum("bdi,b,bdj->ij", self.turn, pulls, self.turn) @ np.eye(self.n, self.width)[: self.r]

    def _wound(self, rows: _Rows) -> np.ndarray:
        """(A, columns of z): delta''."""
        one = np.eye(self.n, self.width, self.n)
        current, load = self._input("current"), self._input("drum_load")
        found = np.zeros((len(self.motors), self.width))
        for a, (j, m) in enumerate(self.model.motors.items()):
            pull = rows.tension[j] + load[a]
            found[a] = (m.torque_constant * current[a] - m.damping * one[self.r + a] - m.radius * pull) / m.inertia
        return found

    def _outputs(self, at: _At, rows: _Rows, accelerations: np.ndarray) -> list[tuple[Field, np.ndarray, np.ndarray]]:
        """Field, values and derivatives over z of all outputs."""
        model, D, strings, wound = self.model, len(self.axes), self.strings, list(self.model.actuated)
        residual = self.mass @ (self.phi @ accelerations[: self.r] + self._given(at)) - rows.force
        held = self._held_by(at, rows, residual)
        free, grounded = model.free_nodes, model.grounded_nodes
        rest = self.state.inputs["rest_length"]
        found = {
            "position": (self.x, rows.x),
            "velocity": (self.v.reshape(-1, D)[free].ravel(), rows.v.reshape(-1, D, self.width)[free].reshape(-1, self.width)),
            "string_force": (strings.tension, rows.tension),
            "elastic_force": (strings.elastic, rows.elastic),
            "string_length": (strings.length, rows.length),
            "wound_rest_length": (rest[wound], rows.rest[wound]),
            "wound_rest_length_rate": (_on_drums(model, self.state)[wound], rows.rest_rate[wound]),
            "motor_speed": (self.state.speed, np.eye(self.n, self.width, self.n)[self.r :]),
            "bar_force": (held.bars, held.by_bars),
            "reaction": (
                held.ground.reshape(-1, D)[grounded].ravel(),
                held.by_ground.reshape(-1, D, self.width)[grounded].reshape(-1, self.width),
            ),
        }
        found |= self._utilisation(found)
        places = {field: list(named(field, model).values()) for field in OUTPUTS if size(field, model.counts)}
        return [(field, *(part[at] for part in found[field.name])) for field, at in places.items()]

    def _held_by(self, at: _At, rows: _Rows, residual: np.ndarray) -> HeldBy:
        """What keeps the structure on its bars and on the ground.  residual: derivatives of M x'' - F over z."""
        model, D = self.model, len(self.axes)
        y = np.eye(self.n, self.width)[: self.r]
        by_lever, turned = self._on_bars(at.residual[:, None])[:, :, 0], self.turn @ y
        density = (self.b * by_lever).sum(1) / self.l2  # lambda
        by = np.einsum("bdz,bd->bz", turned, by_lever) + np.einsum("bd,bdz->bz", self.b, self._on_bars(residual))
        by, length = by / self.l2[:, None], np.sqrt(self.l2)
        ground = at.residual.reshape(-1, D).copy(), residual.reshape(-1, D, self.width).copy()
        for end, sign in ((0, -1.0), (1, 1.0)):
            np.subtract.at(ground[0], model.bars[:, end], sign * density[:, None] * self.b)
            change = self.b[:, :, None] * by[:, None] + density[:, None, None] * turned
            np.subtract.at(ground[1], model.bars[:, end], sign * change)
        return HeldBy(-density * length, -by * length[:, None], ground[0].ravel(), ground[1].reshape(-1, self.width))

    def _utilisation(self, pulls: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Utilisations and their derivatives over z, from those of the forces: constant factors, but where they are 0."""
        model, ((force, by_bars), (tension, by_strings)) = self.model, (pulls[name] for name in ("bar_force", "string_force"))
        bars, strings = bar_utilisation(model, force), string_utilisation(model, tension)
        per_force = np.where(bars > 0.0, -1.0, 0.0) / buckling_load(model)
        per_tension = np.where(strings > 0.0, 1.0, 0.0) / np.array([value for _, value in model.strength])
        return {
            "bar_utilisation": (bars, per_force[:, None] * by_bars[[bar for bar, _ in model.sections]]),
            "string_utilisation": (strings, per_tension[:, None] * by_strings[[string for string, _ in model.strength]]),
        }


class HeldBy(NamedTuple):
    """bars (B,), by_bars (B, columns of z): the bars' forces, tension positive, and their derivatives; ground (n,), by_ground
    (n, columns of z): those of the ground, which matter at nodes that it holds; N."""

    bars: np.ndarray
    by_bars: np.ndarray
    ground: np.ndarray
    by_ground: np.ndarray


class _At(NamedTuple):
    """w (r,) and wdot (r,): y' and y''; winding (A,): delta''; residual (n,): M x'' - F, N."""

    w: np.ndarray
    wdot: np.ndarray
    winding: np.ndarray
    residual: np.ndarray


class _Rows(NamedTuple):
    """Derivatives over z of the nodes' places and velocities (n), the strings' lengths, rest lengths and their rates, elastic
    tensions and tensions (S), and the forces on the nodes (n)."""

    x: np.ndarray
    v: np.ndarray
    length: np.ndarray
    rest: np.ndarray
    rest_rate: np.ndarray
    elastic: np.ndarray
    tension: np.ndarray
    force: np.ndarray
