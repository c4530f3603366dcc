"""Directional derivatives of native FMUs for model exchange, FMI 2.0: against the kernel's, against differences of the very
calls, what is refused."""

import zipfile
from ctypes import c_double, c_uint
from pathlib import Path

import numpy as np
import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.kernel.derivatives import Derivatives
from tests.conftest import once
from tests.fmu.runtimes.test_model_exchange import Exchange
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, built
from tests.support.element_scenes import mast
from tests.support.native_calls import DISCARD, ERROR, MODEL_EXCHANGE, OK

MODELS = {
    "three_bar_nsh": lambda: scene("three_bar_nsh"),
    "laboratory": lambda: built(LABORATORY),
    "memory": lambda: mast("memory"),
}


@pytest.fixture(scope="module", params=MODELS)
def both(request, tmp_path_factory) -> tuple[Path, str]:
    """An extracted FMU of both kinds, and the name of its model."""

    def make(folder):
        fmu = pack_native_fmu(MODELS[request.param](), folder.with_suffix(".fmu"), kind="both")
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)

    return once(tmp_path_factory, f"partials_{request.param}", make), request.param


@pytest.fixture
def calls(both):
    made = []

    def make(mode="continuous", kind=MODEL_EXCHANGE):
        made.append(Partials(both[0], kind=kind))
        made[-1].bring_to(mode)
        return made[-1]

    yield make
    for one in made:
        one.free()


class Partials(Exchange):
    """Products by names of variables."""

    def rates(self):
        return [one.variable.name for one in self.description.derivatives]

    def state_names(self):
        return [one.variable.derivative.name for one in self.description.derivatives]

    def along(self, unknowns, knowns, seed):
        """Status and change of the unknowns."""
        out, given = (c_double * max(len(unknowns), 1))(), (c_double * max(len(knowns), 1))(*seed)
        status = self.do("GetDirectionalDerivative", self.references(unknowns), len(unknowns), self.references(knowns),
                         len(knowns), given, out)  # fmt: skip
        return status, np.array(out)[: len(unknowns)]

    def jacobian(self, unknowns, knowns):
        columns = []
        for known in knowns:
            status, column = self.along(unknowns, [known], [1.0])
            assert status == OK, self.messages
            columns.append(column)
        return np.stack(columns, axis=1)

    def shaken(self):
        """Another state, other inputs."""
        random = np.random.default_rng(4)
        x = self.states()
        x[: self.size - 2] += random.normal(size=self.size - 2) * 0.05
        assert self.put(x) == OK
        forces = [name for name in self.names("input") if ".force." in name or name.endswith(".current")]
        assert self.set(dict(zip(forces, random.normal(size=len(forces)) * 5.0))) == OK
        return x


def kernel_at(both, one, x):
    """The kernel's derivatives at the state and under the values of an instance."""
    model = MODELS[both[1]]()
    kernel = Kernel(model)
    kernel.initialize()
    view = ContinuousView(kernel)
    view.set(0.0, x)
    for variable in one.description.modelVariables:
        if variable.causality in ("input", "parameter") and variable.type == "Real":
            kernel.values[variable.valueReference] = one.get(variable.name)
    d = Derivatives(view)
    d.look()
    return d


def test_all_products_are_the_kernels(both, calls):
    """By all states, inputs and tunable parameters, of all derivatives and real outputs, to the last bit."""
    one = calls()
    d = kernel_at(both, one, one.shaken())
    matrix, first = d.matrix(), d.kernel.first_output
    inputs = one.names("input") + [v.name for v in one.description.modelVariables if v.variability == "tunable"]
    outputs = one.names("output")
    rows = [*range(d.derivatives.start, d.derivatives.stop)]
    rows += [d.outputs.start + one.by_name[name].valueReference - first for name in outputs]
    columns = [*range(one.size), *(one.size + one.by_name[name].valueReference for name in inputs)]
    found = one.jacobian(one.rates() + outputs, one.state_names() + inputs)
    assert np.array_equal(found, matrix[np.ix_(rows, columns)])


def test_products_equal_differences_of_the_calls(calls):
    """Extrapolated central differences of fmi2GetDerivatives and fmi2GetReal by fmi2SetContinuousStates and fmi2SetReal."""
    one = calls()
    x = one.shaken()
    inputs, outputs = one.names("input"), one.names("output")
    start = np.array([one.get(name) for name in inputs])
    found = one.jacobian(one.rates() + outputs, one.state_names() + inputs)

    def at(place, shift):
        y, u = x.copy(), start.copy()
        (y if place < len(x) else u)[place if place < len(x) else place - len(x)] += shift
        assert one.put(y) == OK and one.set(dict(zip(inputs, u))) == OK
        return np.concatenate([one.vector("GetDerivatives")[1], one.get(*outputs)])

    size = np.abs(at(0, 0.0))
    for place in range(len(x) + len(inputs)):
        h = 2e-5
        differences = [(at(place, s) - at(place, -s)) / (2.0 * s) for s in (h, h / 2.0)]
        right = (4.0 * differences[1] - differences[0]) / 3.0
        allowed = 1e-6 * np.abs(right) + 1e-12 * (1.0 + size) / h
        assert np.all(np.abs(found[:, place] - right) <= allowed), place


def test_the_start_is_differentiated_by_start_values(both, calls):
    one = calls("initialization")
    unknowns = [v.name for v in one.description.modelVariables if v.causality in ("output", "local") and v.type == "Real"]
    knowns = [v.name for v in one.description.modelVariables if v.causality in ("input", "parameter") and v.type == "Real"]
    refused = [known for known in knowns if one.along(unknowns, [known], [1.0])[0] != OK]
    compiled = ["s1.stiffness", *(name for name in knowns if ".nsh." in name)] if both[1] == "memory" else []
    assert sorted(refused) == sorted(compiled) and (not compiled or one.said("derivatives by it are not provided"))
    if "b1.mass" in knowns:
        before = one.get(*unknowns)
        slope = one.along(unknowns, ["b1.mass"], [1.0])[1]
        assert one.set({"b1.mass": one.get("b1.mass") + 1e-6}) == OK
        assert (np.array(one.get(*unknowns)) - before) / 1e-6 == pytest.approx(slope, rel=1e-3, abs=1e-4)
        again = one.along(unknowns, ["b1.mass"], [1.0])[1]  # of the new start
        assert np.any(again != slope)


def test_several_directions_are_one_product(calls):
    one = calls()
    one.shaken()
    states, rates = one.state_names(), one.rates()
    seed = np.arange(1.0, len(states) + 1.0)
    matrix = one.jacobian(rates, states)
    together = one.along(rates, states, seed)[1]
    assert together == pytest.approx(matrix @ seed, rel=1e-12, abs=1e-9)
    twice = one.along(rates, [states[0], states[0]], [1.0, 2.0])[1]
    assert np.allclose(twice, 3.0 * matrix[:, 0], rtol=1e-14)
    assert one.along([], states, seed)[0] == OK and one.along(rates, [], []) == (OK, pytest.approx(np.zeros(len(rates))))


def test_tunable_parameters_count_at_once_in_event_mode(calls):
    """A damping coefficient that has been set is that of derivatives and products before the event is carried out, too."""
    one = calls("event")
    states, rates = one.state_names(), one.rates()
    damped = next(v.name for v in one.description.modelVariables if v.name.endswith(".damping") and v.variability == "tunable")
    before = one.jacobian(rates, states)
    slope = one.along(rates, [damped], [1.0])[1]
    assert one.set({damped: one.get(damped) + 100.0}) == OK
    after = one.jacobian(rates, states)
    assert not np.array_equal(before, after)
    assert one.discrete()[0] == OK
    assert np.array_equal(one.jacobian(rates, states), after)
    assert np.allclose(one.along(rates, [damped], [1.0])[1], slope, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("mode", ["instantiated", "initialization", "event", "continuous", "terminated", "error"])
def test_in_every_mode_that_the_standard_allows(calls, mode):
    one = calls(mode)
    status, _ = one.along(one.rates(), [one.names("input")[0]], [1.0])
    allowed = mode != "instantiated"
    assert status == (OK if allowed else DISCARD), one.messages


def test_what_is_refused_changes_nothing_and_says_why(both, calls):
    one = calls()
    x = one.shaken()
    rates, states = one.rates(), one.state_names()
    matrix = one.jacobian(rates, states)
    mass = next(v.name for v in one.description.modelVariables if v.name.endswith(".mass"))
    output = next(name for name in one.names("output") if not name.startswith("energy"))
    for unknowns, knowns, words in (
        (rates, [mass], (mass, "fixed after initialization")),
        (rates, [output], (output, "computed, and no state")),
        ([one.names("input")[0]], states[:1], (one.names("input")[0], "is not computed")),
        ([mass], states[:1], (mass, "is not computed")),
    ):
        one.messages.clear()
        assert one.along(unknowns, knowns, [1.0])[0] == DISCARD and one.said("GetDirectionalDerivative", *words)
    nowhere, out = (c_uint * 1)(4_000_000_000), (c_double * 1)()
    known = one.references(states[:1])
    assert one.do("GetDirectionalDerivative", nowhere, 1, known, 1, (c_double * 1)(1.0), out) == DISCARD
    assert one.do("GetDirectionalDerivative", None, 1, known, 1, (c_double * 1)(1.0), out) == DISCARD
    assert one.do("GetDirectionalDerivative", known, 1, known, 1, None, out) == DISCARD
    assert one.along(rates, states[:1], [np.inf])[0] == DISCARD
    assert np.array_equal(one.states(), x) and np.array_equal(one.jacobian(rates, states), matrix)


def test_a_state_far_off_is_refused_and_others_still_work(calls):
    one = calls()
    x = one.states()
    far = x.copy()
    far[len(x) // 2] = 1e300
    assert one.put(far) == OK
    assert one.along(one.rates(), one.state_names()[:1], [1.0])[0] == DISCARD
    assert one.put(x) == OK and one.along(one.rates(), one.state_names()[:1], [1.0])[0] == OK


def test_co_simulation_of_the_second_version_has_none(calls):
    one = calls("stepping", kind=1)
    assert one.along(one.names("output")[:1], one.names("input")[:1], [1.0])[0] == DISCARD
    assert one.said("in co-simulation directional derivatives are not provided")
    assert ERROR not in [status for status, _, _ in one.messages]


def test_a_number_that_counts_beams_does_not_change(calls):
    """Some importers, CasADi among them, ask for every output."""
    one = calls()
    counts = one.names("output", "Integer")
    status, found = one.along([*one.rates()[:1], *counts], one.state_names()[:1], [1.0])
    assert status == OK and not found[1:].any() and len(found) == 1 + len(counts)
    if counts:
        assert one.along(one.rates(), counts[:1], [1.0])[0] == DISCARD and one.said("no Real variable")
