"""Continuous states and their derivatives as variables of model exchange FMUs, and on what derivatives and outputs depend then.

States stand in the order of the kernel's continuous-time view: coordinates, their rates, and the two integrals of the energy
ledger, which are outputs.  References follow those of the kernel's blocks: states that are no outputs, then the derivatives of
all.  The scale of the ledger is left out: nobody integrates it there.

Dependencies are those of the structure's graph.  Strings couple what hangs at their ends, on states and on the inputs of the
same instant, in continuous time and in events; tunable parameters, which change in events, stand apart: tunables.py.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tensegrity_core.fields import FIELDS
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.model import Model
from tensegrity_core.model.components import AXES

from .dependencies import KNOWN, Places
from .initial_states import Start
from .interface import Array, Variable, flat, require_unique, variables
from .tunables import Tunables

#: Outputs that have no place in model exchange.
LEFT_OUT = ("throughput",)
#: Settings of the kernel's solver.
SOLVER = ("method", "tolerance", "max_step")
#: Units of derivatives by those of the states.
RATES_OF = {"m": "m/s", "m/s": "m/s2", "J": "W"}
#: What the event indicators of a string say.
INDICATED = (
    "how far it is from the lower end of its piece of the force curve (m)",
    "from the upper end (m)",
    "from being clipped or released (N)",
)
#: Outputs that are states, in the order in which they are the last ones.
INTEGRALS = ("dissipated", "input_work")


def exchange_variables(model: Model, naming: str = "structured") -> tuple[Variable, ...]:
    """The variables of an FMU for model exchange, in order of their references; outputs and derivatives with what they
    depend on; of an input of which nothing is known here, all of them.  Raises ValueError where two would get the same name."""
    table = [row for row in variables(model, naming) if row.field not in LEFT_OUT]
    graph, nominals = Graph(model), ContinuousView(Kernel(model)).nominals
    start, states, tunables = Start(graph), _states(graph, nominals, naming), Tunables(graph)
    integrals = [row for field in INTEGRALS for row in table if row.field == field]
    rates = [
        replace(
            _rate_of(state, graph.rate(i), nominals[i], naming),
            depends=graph.derivative(i),
            tuned=tunables.derivative(i),
            known=tuple(start.derivative(i)),
            constant=i < graph.half,
        )
        for i, state in enumerate([*states, *integrals])
    ]
    states = [replace(row, known=tuple(start.state(i))) for i, row in enumerate(states)]
    table = [
        replace(row, depends=graph.output(row.reference), tuned=tunables.output(row.reference))
        if row.causality == "output"
        else row
        for row in table
    ]
    found = _with_unknown([*table, *states, *rates])
    require_unique(found)
    return found


def _with_unknown(table: list[Variable]) -> tuple[Variable, ...]:
    """The table with what is said to depend on references of variables alone, and on all inputs and parameters of which nothing
    is known here."""
    visible = frozenset(row.reference for row in table)
    inputs, parameters = _unknown(table, "input"), _unknown(table, "parameter")
    tunable = frozenset(row.reference for row in table if row.variability == "tunable")
    found = []
    for row in table:
        if row.depends is not None:
            row = replace(row, depends=(row.depends | inputs) & visible, tuned=(row.tuned | parameters) & tunable)
        if row.causality == "local":
            row = replace(row, known=tuple(sorted((inputs | parameters).union(row.known) & visible)))
        found.append(row)
    return tuple(found)


def _unknown(table: Iterable[Variable], causality: str) -> frozenset[int]:
    """Inputs or parameters of which nothing is known here: everything may depend on them."""
    return frozenset(row.reference for row in table if row.causality == causality and row.field not in KNOWN)


def without_solver(table: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """The table of an FMU whose host always integrates: the kernel's solver has nothing to say there."""
    hidden = {row.reference for row in table if row.field in SOLVER}
    return tuple(
        replace(row, known=tuple(one for one in row.known if one not in hidden)) for row in table if row.field not in SOLVER
    )


def event_indicators(model: Model, table: tuple[Variable, ...], first: int, naming: str = "structured") -> tuple[Variable, ...]:
    """The event indicators as variables of FMI 3.0, in the order of the kernel's, with what they depend on.

    table: the variables that there are; first: the reference of the first of them.
    """
    graph = Graph(model)
    found: list[Variable] = []
    tunables, tunable = Tunables(graph), {row.reference for row in table if row.variability == "tunable"}
    visible, others = {row.reference for row in table}, _unknown(table, "input")
    each = ContinuousView(Kernel(model)).indicators // max(len(model.strings), 1)
    for s, string in enumerate(model.string_names):
        whole = Array(
            f"{string}.event_indicators", f"string {string}: {', '.join(INDICATED[:each])}; negative: an event is due"
        )
        for i in range(each):
            row = _local(first + len(found), f"{whole.name}[{i + 1}]", "1", INDICATED[i], 1.0, naming, whole)
            depends = ((graph.tension(s) if i == 2 else graph.elastic(s)) | others) & visible
            tuned = (tunables.indicator(s, i) | _unknown(table, "parameter")) & tunable
            found.append(replace(row, unit=None, nominal=None, depends=frozenset(depends), tuned=tuned))
    return tuple(found)


def _states(graph: Graph, nominals: np.ndarray, naming: str) -> list[Variable]:
    """The states that are no outputs."""
    told = " (continuous state)"
    axes = f"; {', '.join(AXES[i] for i in graph.model.axes)}{told}"
    found = []
    for i, (name, unit, meaning, whole) in enumerate(zip(graph.names, graph.units, graph.meanings, graph.arrays)):
        array = None if whole is None else Array(whole.name, whole.description + axes)
        found.append(_local(graph.first + i, name, unit, meaning + told, nominals[i], naming, array))
    return found


def _rate_of(state: Variable, reference: int, nominal: float, naming: str) -> Variable:
    """The derivative of a state."""

    def named(name: str) -> tuple[str, str]:
        return f"der({name})" if naming != "flat" else f"der_{name}", f"derivative of {name}"

    (name, meaning), array = named(state.name), None if state.array is None else Array(*named(state.array.name))
    row = _local(reference, name, RATES_OF[str(state.unit)], meaning, nominal, naming, array)
    return replace(row, derivative_of=state.reference)


def _local(reference: int, name: str, unit: str, meaning: str, nominal: float, naming: str, array: Array | None) -> Variable:
    return Variable(
        name=flat(name) if naming == "flat" else name,
        reference=reference,
        kind="Real",
        causality="local",
        variability="continuous",
        initial="calculated",
        unit=unit,
        start=None,
        min=None,
        max=None,
        nominal=float(nominal),
        description=meaning,
        field="",
        known=(),
        array=None if array is None else Array(flat(array.name) if naming == "flat" else array.name, array.description),
    )


class Graph:
    """What hangs on what.  A block is a list of coordinates that strings and forces act on together, each along an axis,
    counted among those that the scene uses, or one along none.  Nodes of bars beyond class 1 have blocks of their own.

    names, units, meanings, arrays: of the states that are no outputs; first: the reference of the first of them."""

    def __init__(self, model: Model):
        self.model, self.places = model, Places(model)
        self.axes = len(model.axes)
        self.first = self.places.end
        self.blocks: list[tuple[str, tuple[int, ...], str]] = []  # name, axes, meaning
        every = tuple(range(self.axes))
        self.of_node: dict[int, list[int]] = {node: [] for node in range(len(model.nodes))}
        self.of_bar: list[list[int]] = []
        for b, ends in enumerate(model.bars.tolist()):
            name, free = model.bar_names[b], [node for node in ends if not model.fixed[node]]
            own: list[int] = []
            self.of_bar.append(own)
            if b in self.places.group_of:
                continue
            if len(free) == 2:
                own.append(self._add(f"{name}.center", every, f"bar {name}: centre of mass with its point masses"))
            own.append(
                self._add(
                    f"{name}.vector",
                    every,
                    f"bar {name}: vector from its first node to its second"
                    if len(free) == 2
                    else f"bar {name}: vector from its fixed node to its other",
                )
            )
            for node in free:
                self.of_node[node] = own
        lone, single = model.lone_nodes.tolist(), {node for node, _ in model.partly_fixed}
        last = [node for node in model.free_nodes.tolist() if node in self.places.joined or (node in lone and node in single)]
        for node in [node for node in lone if node not in last] + last:
            name, what = model.node_names[node], "point mass" if node in lone else "node"
            self.of_node[node] = [self._add(f"{name}.coordinate", every, f"{what} {name}: position")]
        self.motor = {}
        for s in model.actuated:
            name = model.string_names[s]
            self.motor[s] = self._add(f"{name}.actuator.wound", (), f"string {name}: length that its actuator has wound in")
        self.starts = np.cumsum([0, *(len(axes) or 1 for _, axes, _ in self.blocks)])
        self.half = int(self.starts[-1])
        self.names, self.units, self.meanings = [], [], []
        self.arrays: list[Array | None] = []
        for suffix, unit, of in (("", "m", ""), ("_rate", "m/s", "rate of ")):
            for name, axes, meaning in self.blocks:
                whole = None if axes != every else Array(f"{name}{suffix}", f"{of}{meaning}")
                for along in [f".{AXES[model.axes[axis]]}" for axis in axes] or [""]:
                    self.names.append(f"{name}{suffix}{along}")
                    self.units.append(unit)
                    self.meanings.append(f"{of}{meaning}{f', along {along[1:]}' if along else ''}")
                    self.arrays.append(whole)

    def _add(self, name: str, axes: tuple[int, ...], meaning: str) -> int:
        self.blocks.append((name, axes, meaning))
        return len(self.blocks) - 1

    def rate(self, state: int) -> int:
        """Reference of a state's derivative."""
        return self.first + 2 * self.half + state

    # --- sets of references ---------------------------------------------------------------------------------------------

    def coordinates(self, blocks, rates: bool = False, axis: int | None = None) -> set[int]:
        """Of the states of these blocks, or of their rates; axis: that one only."""
        found, offset = set(), self.first + (self.half if rates else 0)
        for block in blocks:
            first, axes = offset + int(self.starts[block]), self.blocks[block][1] or (None,)
            found |= {first + i for i, along in enumerate(axes) if axis in (None, along)}
        return found

    def place(self, coordinate: int) -> tuple[int, int]:
        """Block of a coordinate, and its axis there; 0 where it has none."""
        block = int(np.searchsorted(self.starts, coordinate, side="right")) - 1
        return block, (self.blocks[block][1] or (0,))[coordinate - int(self.starts[block])]

    def moved(self, field: str, node: int, axis: int | None = None) -> set[int]:
        """An input of the moved node that this one is, or whose bar of class 1 it belongs to."""
        movers = self.places.movers.get(node, ())
        if node in self.places.joined:
            movers = tuple(i for i in movers if self.model.moving[i] == node)
        return {self.places.at(field, e * self.axes + i) for e in movers for i in range(self.axes) if axis in (None, i)}

    def position(self, node: int, axis: int | None = None) -> set[int]:
        return self.coordinates(self.of_node[node], False, axis) | self.moved("node_position", node, axis)

    def velocity(self, node: int, axis: int | None = None) -> set[int]:
        return self.coordinates(self.of_node[node], True, axis) | self.moved("node_velocity", node, axis)

    def length(self, s: int) -> set[int]:
        return set().union(*(self.position(node) for node in self.model.paths[s]))

    def elastic(self, s: int) -> set[int]:
        own = self.coordinates([self.motor[s]]) if s in self.motor else set()
        return self.length(s) | own | {self.places.at("rest_length", s)}

    def tension(self, s: int) -> set[int]:
        rates = set().union(*(self.velocity(node) for node in self.model.paths[s]))
        own = self.coordinates([self.motor[s]], True) if s in self.motor else set()
        return self.elastic(s) | rates | own | {self.places.at("rest_length_rate", s)}

    def damping(self, s: int) -> set[int]:
        """What a string's damper takes; of a clipped string all that its spring gives."""
        own = self.coordinates([self.motor[s]]) if s in self.motor else set()
        return self.tension(s) - ({self.places.at("rest_length", s)} | own if self.model.damping_law == "literal" else set())

    def on_node(self, node: int, along: int | None = None) -> set[int]:
        """The force on a node by strings, drag and, where it is free, the input; along: its part along that axis."""
        found: set[int] = set()
        for s, path in enumerate(self.model.paths):
            if node in path:
                found |= self.tension(s)
        if any(at == node for at, _ in self.model.drag):
            found |= self.velocity(node, along)
        for f in np.flatnonzero(self.model.free_nodes == node):
            axes = range(self.axes) if along is None else [along]
            found |= {self.places.at("force", int(f) * self.axes + axis) for axis in axes}
        return found

    def on_group(self, b: int) -> set[int]:
        """What accelerates the nodes of a bar that moves others, and bears on all of them."""
        nodes = self.places.group_of[b].nodes
        found: set[int] = set()
        for node in nodes:
            found |= set() if self.model.fixed[node] else self.on_node(node)
            found |= self.position(node) | self.velocity(node) | self.moved("node_acceleration", node)
        return found

    def on_bar(self, b: int, along: int | None = None) -> set[int]:
        """What accelerates a bar: the forces at its free ends, and its pin; of one that moves others those of its group."""
        if b in self.places.group_of:
            return self.on_group(b)
        ends = [int(node) for node in self.model.bars[b]]
        free = [node for node in ends if not self.model.fixed[node]]
        found = set().union(*(self.on_node(node, along) for node in free))
        return found.union(*(self.moved("node_acceleration", node) for node in ends))

    # --- what is asked --------------------------------------------------------------------------------------------------

    def derivative(self, state: int) -> frozenset[int]:
        """On what the derivative of a state depends."""
        if state < self.half:
            return frozenset({self.first + self.half + state})
        if state >= 2 * self.half:
            return frozenset(self._power(state - 2 * self.half))
        block, axis = self.place(state - self.half)
        for s, motor in self.motor.items():
            if motor == block:
                a = list(self.motor).index(s)
                inputs = {self.places.at("current", a), self.places.at("drum_load", a)}
                return frozenset(self.tension(s) | self.coordinates([block], True) | inputs)
        for b, own in enumerate(self.of_bar):
            if block in own[-1:]:  # turns: what acts along one axis moves it along the others
                return frozenset(self.on_bar(b) | self.coordinates([block]) | self.coordinates([block], True))
            if block in own:
                return frozenset(self.on_bar(b, axis))
        node = next(node for node, own in self.of_node.items() if own == [block])
        group = self.places.joined.get(node)
        return frozenset(self.on_node(node, axis) if group is None else self.on_group(group.bars[0]))

    def _power(self, which: int) -> set[int]:
        """Of the dissipated energy (0), of the input work (1)."""
        model = self.model
        if which == 0:
            dampers = (self.damping(s) for s in range(len(model.strings)))
            dragged = (self.velocity(node) for node, _ in model.drag)
            return set().union(*dampers, *dragged, *(self.coordinates([motor], True) for motor in self.motor.values()))
        found = set().union(*(self.tension(s) for s in range(len(model.strings)) if s not in self.motor))
        for f, node in enumerate(model.free_nodes.tolist()):
            found |= {self.places.at("force", f * self.axes + axis) for axis in range(self.axes)} | self.velocity(node)
        for a, motor in enumerate(self.motor.values()):
            found |= {self.places.at("current", a), self.places.at("drum_load", a)} | self.coordinates([motor], True)
        for node in model.moving:
            found |= self.on_node(node) | self.moved("node_velocity", node) | self.moved("node_acceleration", node)
            for b, ends in enumerate(model.bars.tolist()):
                if node in ends:
                    found |= self.on_bar(b) | self.coordinates(self.of_bar[b]) | self.coordinates(self.of_bar[b], True)
        return found

    def output(self, reference: int) -> frozenset[int]:
        """On what an output depends."""
        field, place = self.places.field_of(reference)
        method = getattr(self, f"output_{field}", None)
        return frozenset(method(place) if method else self._everything())

    def _everything(self) -> set[int]:
        inputs = (self.places.all(field.name) for field in FIELDS if field.role == "input")
        return set(range(self.first, self.first + 2 * self.half)).union(*inputs)

    def output_position(self, i: int) -> set[int]:
        return self.position(i // self.axes, i % self.axes)

    def output_velocity(self, i: int) -> set[int]:
        return self.velocity(int(self.model.free_nodes[i // self.axes]), i % self.axes)

    def output_string_force(self, s: int) -> set[int]:
        return self.tension(s)

    def output_elastic_force(self, s: int) -> set[int]:
        return self.elastic(s)

    def output_string_length(self, s: int) -> set[int]:
        return self.length(s)

    def output_snapped(self, i: int) -> set[int]:
        return self.elastic(self.model.nsh_strings[i])

    def output_wound_rest_length(self, a: int) -> set[int]:
        s = self.model.actuated[a]
        return self.coordinates([self.motor[s]]) | {self.places.at("rest_length", s)}

    def output_wound_rest_length_rate(self, a: int) -> set[int]:
        return self.coordinates([self.motor[self.model.actuated[a]]], True)

    output_motor_speed = output_wound_rest_length_rate

    def output_bar_force(self, b: int) -> set[int]:
        own = self.of_bar[b][-1:]
        return self.on_bar(b) | self.coordinates(own) | self.coordinates(own, True)

    def output_bar_utilisation(self, i: int) -> set[int]:
        return self.output_bar_force(self.model.sections[i][0])

    def output_string_utilisation(self, i: int) -> set[int]:
        return self.tension(self.model.strength[i][0])

    def output_reaction(self, i: int) -> set[int]:
        node, axis = int(self.model.grounded_nodes[i // self.axes]), i % self.axes
        found = self.on_node(node)
        bars = [b for b, ends in enumerate(self.model.bars.tolist()) if node in ends]
        if self.places.point_masses(node) and not bars:
            found |= self.moved("node_acceleration", node, axis)
        for b in bars:
            found |= self.output_bar_force(b)
        return found

    def output_kinetic(self, _: int) -> set[int]:
        rates = self.coordinates(range(len(self.blocks)), True)
        return rates.union(*(self.moved("node_velocity", node) for node in self.model.moving))

    def output_potential(self, _: int) -> set[int]:
        model = self.model
        falls = range(self.axes) if model.counts["V"] > 1 else [i for i, axis in enumerate(model.axes) if axis == 2]
        masses = {own[0] for own in (*self.of_bar, *self.of_node.values()) if own}  # a free bar's is at its centre of mass
        on_bars = set(model.bars.ravel().tolist())
        grounds = [node for node in model.moving if node in on_bars or self.places.point_masses(node)]
        found = (self.coordinates(masses, False, axis) for axis in falls)
        return set().union(*found, *(self.moved("node_position", node, axis) for node in grounds for axis in falls))

    def output_elastic(self, _: int) -> set[int]:
        return set().union(*(self.elastic(s) for s in range(len(self.model.strings))))

    def output_dissipated(self, _: int) -> set[int]:
        return {self.places.at("dissipated", 0)}

    def output_input_work(self, _: int) -> set[int]:
        return {self.places.at("input_work", 0)}
