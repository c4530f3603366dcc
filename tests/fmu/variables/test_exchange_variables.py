"""Model exchange: what the description says of states, derivatives and dependencies, against the kernel."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from fmu_src.packing.libraries import here, host_library
from fmu_src.packing.native_fmu import Contents, native_fmu_files
from fmu_src.variables.interface import variables
from fmu_src.variables.states import LEFT_OUT, SOLVER, exchange_variables
from tensegrity_core.fields import FIELDS
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.scene import builtin_scenes
from tests.fmu.variables.test_fmu_schemas import problems
from tests.support import scene
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, built
from tests.support.rigged_scenes import RIGGED

MODELS = {
    **{name: lambda name=name: scene(name) for name in builtin_scenes()},
    "laboratory": lambda: built(LABORATORY),
    "rigged": lambda: built(RIGGED),
    "mast": lambda: built(MAST),
    "pendulum": lambda: built(PENDULUM, moving=["n1"], point_masses={"n2": 0.5}, drag={"n2": 0.4}),
    "afloat": lambda: built(AFLOAT, gravity=9.81),
}


@pytest.mark.parametrize("kind", ["me", "both"])
@pytest.mark.parametrize("name", MODELS)
def test_descriptions_keep_the_schemas(name, kind):
    files = native_fmu_files(MODELS[name](), Contents(kind=kind), {here(): host_library()})
    assert problems(files) == []


@pytest.mark.parametrize("kind, tolerance", [("cs", 1e-10), ("both", 1e-10), ("me", 1e-8)])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_a_host_that_integrates_is_told_a_tolerance_that_its_solver_can_keep(kind, tolerance, fmi):
    files = native_fmu_files(scene("two_bar"), Contents(kind=kind, standard=fmi), {here(): host_library()})
    root = ElementTree.fromstring(files["modelDescription.xml"])
    assert float(root.find("DefaultExperiment").get("tolerance")) == tolerance


@pytest.mark.parametrize("name", MODELS)
def test_states_and_derivatives_are_those_of_the_kernel(name):
    model = MODELS[name]()
    table, view = exchange_variables(model), ContinuousView(Kernel(model))
    rates = [row for row in table if row.causality == "local" and row.derivative_of is not None]
    assert len(rates) == view.size
    by_reference = {row.reference: row for row in table}
    states = [by_reference[row.derivative_of] for row in rates]
    assert len({row.reference for row in states}) == view.size
    assert [row.name for row in rates] == [f"der({row.name})" for row in states]
    assert [row.name for row in states[-2:]] == ["energy.dissipated", "energy.input_work"]
    half = (view.size - 2) // 2
    assert [row.unit for row in states] == ["m"] * half + ["m/s"] * half + ["J", "J"]
    kept = [row for row in variables(model) if row.field not in LEFT_OUT]
    assert [
        replace(row, depends=None, tuned=frozenset()) for row in table[: len(kept)]
    ] == kept  # all others are co-simulation's


def changed(now, before):
    return np.flatnonzero(np.abs(now - before) > 1e-10 * (1.0 + np.abs(before)))


@pytest.mark.parametrize("name", ["laboratory", "three_bar_nsh", "pendulum", "two_bar", "mast", "afloat"])
def test_dependencies_are_those_of_the_kernel(name):
    """A number that is not said to depend on another stays, to round-off, when that changes; and nothing is said to depend that
    does not, at some of a few random states with all strings taut."""
    model = MODELS[name]()
    table = {row.reference: row for row in exchange_variables(model)}
    kernel = Kernel(model)
    kernel.initialize()
    view, random = ContinuousView(kernel), np.random.default_rng(11)
    first, n = kernel.first_output, len(kernel.values)
    counted, half = n + len(kernel.integers), (view.size - 2) // 2
    integrals = [row.reference for field in ("dissipated", "input_work") for row in table.values() if row.field == field]
    references = [*range(counted, counted + 2 * half), *integrals]
    inputs = [row.reference for row in table.values() if row.causality == "input"]
    found = {reference: set() for reference, row in table.items() if row.depends is not None}

    def seen(x):
        view.set(0.0, x)
        rates = view.derivatives()
        view.outputs()
        return np.concatenate((kernel.values[first:], rates))

    shown = [*range(first, n), *range(counted + 2 * half, counted + 2 * half + view.size)]
    kernel["rest_length"][:] *= 0.9
    for _ in range(3):
        x = view.states + 0.02 * random.normal(size=view.size)
        for row in (table[reference] for reference in inputs):
            if row.field != "rest_length":
                kernel.values[row.reference] += 0.1 * random.normal()
        view.set(0.0, x)
        view.enter_event()
        view.update_discrete()
        x = view.states + 1e-3 * random.normal(size=view.size)  # no longer round numbers
        base = seen(x)
        for place, reference in enumerate(references):
            other = x.copy()
            other[place] += 1e-3 * (1.0 + random.random())
            for at in changed(seen(other), base):
                if shown[at] in found:
                    found[shown[at]].add(reference)
        for reference in inputs:
            before = kernel.values[reference].item()
            kernel.values[reference] += 1e-3 * (1.0 + random.random())
            for at in changed(seen(x), base):
                if shown[at] in found:
                    found[shown[at]].add(reference)
            kernel.values[reference] = before
    for reference, measured in found.items():
        row = table[reference]
        if row.kind == "Real":
            names = [{table[one].name for one in some} for some in (measured, row.depends)]
            assert names[0] == names[1], f"{row.name}: depends {names[0] - names[1]}, and does not on {names[1] - names[0]}"


def started(view):
    """States and derivatives at a new start."""
    view.kernel.initialize()
    return np.concatenate((view.states, view.derivatives()))


@pytest.mark.parametrize("name", MODELS)
def test_states_at_the_start_depend_on_what_is_said(name):
    """Each known is perturbed at two random starts: the states and derivatives that move are those that say so.  The nodes are
    shifted, else a force may be straight across what it could move."""
    model = MODELS[name]()
    shift = np.zeros_like(model.nodes)
    shift[:, model.axes] = 0.01 * np.random.default_rng(7).random((len(model.nodes), len(model.axes)))
    model = replace(model, nodes=model.nodes + shift)
    table = exchange_variables(model)
    rows = {row.reference: row for row in table}
    rates = [row for row in table if row.causality == "local" and row.derivative_of is not None]
    shown = [*(row.derivative_of for row in rates), *(row.reference for row in rates)]
    found = {reference: set() for reference in shown}
    knowns = [row for row in table if row.causality in ("input", "parameter") and row.field not in SOLVER]
    for seed in range(2):
        kernel, random = Kernel(model), np.random.default_rng(seed)
        view = ContinuousView(kernel)
        for i, nsh in model.honeycombs.items():
            kernel["rest_length"][i] -= 2.1 * seed * sum(nsh.h)  # bottomed out
        kernel["rest_length"][:] -= random.uniform(0.005, 0.03, len(model.strings))
        kernel["rest_length_rate"][:] = -random.random(len(model.strings))
        for field in ("force", "node_velocity", "node_acceleration"):
            kernel[field][:] = random.normal(size=len(kernel[field]))
        base = started(view)
        for row in knowns:
            before = kernel.values[row.reference].item()
            kernel.values[row.reference] = before + (1e-3 if abs(before) < 1.0 else 1e-3 * abs(before))
            for at in changed(started(view), base):
                found[shown[at]].add(row.reference)
            kernel.values[row.reference] = before
    for reference, measured in found.items():
        row = rows[reference]
        if row.causality == "local":
            names = [{rows[one].name for one in some if rows[one].field not in SOLVER} for some in (measured, row.known)]
            assert names[0] == names[1], f"{row.name}: depends {names[0] - names[1]}, and does not on {names[1] - names[0]}"


def test_co_simulation_has_what_it_had():
    """No state, no derivative and no event indicator where nobody asks for them."""
    files = native_fmu_files(scene("three_bar_nsh"), Contents(), {here(): host_library()})
    text = files["modelDescription.xml"].decode()
    for word in ("ModelExchange", "der(", "numberOfEventIndicators", "Derivatives", 'causality="local"'):
        assert word not in text
    assert "energy.throughput" in text and {field.name for field in FIELDS} >= set(LEFT_OUT)
