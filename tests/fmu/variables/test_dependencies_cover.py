"""What descriptions list as dependencies against the kernel's derivatives: where nothing is listed, nothing
changes."""

from dataclasses import replace

import numpy as np
import pytest

from fmu_src.variables.states import Graph, exchange_variables
from tensegrity_core.scene import builtin_scenes
from tests.support import scene
from tests.support.derivative_states import Bench
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, RATED, built
from tests.support.element_scenes import mast
from tests.support.rigged_scenes import RIGGED

#: Of the largest derivative of the same unknown: what is left of terms that cancel.
ROUND_OFF = 1e-15
DRIVEN = {"laboratory": LABORATORY, "pendulum": PENDULUM, "afloat": AFLOAT, "winch": MAST, "rated": RATED, "rigged": RIGGED}


def model_of(name, law):
    found = scene(name) if name in builtin_scenes() else built(DRIVEN[name]) if name in DRIVEN else mast(name)
    return replace(found, damping_law=law)


class Places:
    """References of an FMU against places among the kernel's knowns and unknowns."""

    def __init__(self, bench, model):
        d, graph = bench.derivatives, Graph(model)
        self.first, self.half, self.size = graph.first, graph.half, bench.view.size
        self.block, self.outputs, self.output = bench.kernel.first_output, d.outputs.start, d.output("dissipated").start
        self.integrals = self.block + self.output - self.outputs

    def known(self, reference):
        """None: it is a number that a solver does not change."""
        if reference < self.block:
            return self.size + reference
        if self.first <= reference < self.first + 2 * self.half:
            return reference - self.first
        if self.integrals <= reference < self.integrals + 2:
            return 2 * self.half + reference - self.integrals
        return None

    def unknown(self, reference):
        if reference < self.first:
            return self.outputs + reference - self.block
        state = reference - self.first
        return state if state < 2 * self.half else self.size + state - 2 * self.half


def uncovered(matrix, table, places, listed, knowns):
    """Names of an unknown and a known that it depends on and that nothing lists."""
    names = {row.reference: row.name for row in table}
    found = []
    for row in table:
        if row.kind != "Real" or listed(row) is None:
            continue
        derivatives = matrix[places.unknown(row.reference)]
        met = [one for one in knowns if derivatives[places.known(one)] > ROUND_OFF * derivatives.max()]
        found += [(row.name, names[one]) for one in met if one not in listed(row)]
    return found


def lists(row):
    return None if row.depends is None else row.depends | row.tuned


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("name", [*builtin_scenes(), *DRIVEN, "memory", "chain", "progressive"])
def test_lists_cover_all_derivatives(name, law):
    """At random states on all pieces: outputs and derivatives of states, by states, inputs and tunable parameters."""
    model = model_of(name, law)
    table, bench = exchange_variables(model), Bench(model)
    places = Places(bench, model)
    states = {row.derivative_of for row in table if row.causality == "local" and row.derivative_of is not None}
    given = {row.reference for row in table if row.causality == "input" or row.variability == "tunable"}
    knowns = sorted(states | given)
    seen = np.zeros((bench.derivatives.unknowns, bench.derivatives.knowns))
    for trial in range(8):
        bench.shake(trial)
        bench.derivatives.look()
        seen += np.abs(bench.derivatives.matrix())
    assert uncovered(seen, table, places, lists, knowns) == []
    real = [row for row in table if row.kind == "Real" and row.depends is not None]
    met = [seen[places.unknown(row.reference), places.known(one)] != 0.0 for row in real for one in lists(row)]
    assert np.mean(met) > 0.9  # and little that never counts


@pytest.mark.parametrize("name", [*builtin_scenes(), *DRIVEN, "memory", "chain", "progressive"])
def test_lists_cover_all_derivatives_at_the_start(name):
    model = model_of(name, "literal")
    table, bench = exchange_variables(model), Bench(model)
    places, kernel = Places(bench, model), bench.kernel
    seen = np.zeros((bench.derivatives.unknowns, bench.derivatives.knowns))
    for trial in range(4):
        kernel.reset()
        for field in ("force", "rest_length_rate", "current", "drum_load", "node_velocity", "node_acceleration", "point_mass"):
            kernel[field][:] += np.abs(bench.random.normal(size=len(kernel[field]))) * (trial > 0)
        kernel.initialize()
        bench.derivatives.look(start=True)
        seen += np.abs(bench.derivatives.matrix())
    knowns = sorted(
        row.reference
        for row in table
        if row.kind == "Real"
        and row.causality in ("input", "parameter")
        and bench.derivatives.differentiable(places.known(row.reference))
    )
    assert uncovered(seen, table, places, lambda row: row.known if row.causality in ("output", "local") else None, knowns) == []


def test_an_unlisted_dependency_is_found():
    model = scene("three_bar")
    table, bench = exchange_variables(model), Bench(model)
    bench.shake(1)
    bench.derivatives.look()
    matrix = np.abs(bench.derivatives.matrix())
    force = next(row for row in table if row.field == "string_force")
    cut = [replace(row, depends=row.depends - {max(row.depends)}) if row is force else row for row in table]
    knowns = sorted(force.depends)
    assert uncovered(matrix, table, Places(bench, model), lists, knowns) == []
    assert [one for one, _ in uncovered(matrix, cut, Places(bench, model), lists, knowns)] == [force.name]
