"""Directional and adjoint derivatives of native FMUs of FMI 3.0 through fmpy, with arrays: model exchange against the
kernel's, and what co-simulation has."""

import zipfile
from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave

from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.kernel.derivatives import Derivatives
from tests.conftest import once
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, built

MODELS = {"three_bar_nsh": lambda: scene("three_bar_nsh"), "laboratory": lambda: built(LABORATORY)}


@pytest.fixture(scope="module", params=MODELS)
def both(request, tmp_path_factory) -> tuple[Path, str]:
    """An extracted FMU of both kinds, and the name of its model."""

    def make(folder):
        fmu = pack_native_fmu(MODELS[request.param](), folder.with_suffix(".fmu"), kind="both", standard="3.0")
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)

    return once(tmp_path_factory, f"fmi3_partials_{request.param}", make), request.param


class Instance:
    """One instance, and the variables of its FMU by name."""

    def __init__(self, folder: Path, kind: type = FMU3Model, **instantiation):
        self.description = read_model_description(str(folder))
        self.by_name = {variable.name: variable for variable in self.description.modelVariables}
        identifier = self.description.modelExchange.modelIdentifier
        self.messages: list[str] = []
        self.fmu = kind(guid=self.description.guid, modelIdentifier=identifier, unzipDirectory=str(folder), instanceName="one")
        self.fmu.instantiate(logMessage=lambda *words: self.messages.append(str(words[-1])), **instantiation)

    def start(self, inside: bool = False):
        self.fmu.enterInitializationMode()
        if not inside:
            self.fmu.exitInitializationMode()
        return self

    def integrated(self):
        """In Continuous-Time Mode."""
        self.start()
        self.fmu.updateDiscreteStates()
        self.fmu.enterContinuousTimeMode()
        return self

    def free(self):
        self.fmu.freeInstance()

    def names(self, *causalities, tunable=False):
        found = [v for v in self.description.modelVariables if v.causality in causalities and v.type == "Float64"]
        return [v.name for v in found if not tunable or v.variability == "tunable"]

    def span(self, name):
        variable = self.by_name[name]
        return int(np.prod([int(d.start) for d in variable.dimensions] or [1]))

    def elements(self, names):
        """References of all elements."""
        return [self.by_name[name].valueReference + k for name in names for k in range(self.span(name))]

    def references(self, names):
        return [self.by_name[name].valueReference for name in names]

    def size(self, names):
        return sum(map(self.span, names))

    def get(self, names):
        return np.array(self.fmu.getFloat64(self.references(names), self.size(names)))

    def along(self, unknowns, knowns, seed):
        return np.array(
            self.fmu.getDirectionalDerivative(self.references(unknowns), self.references(knowns), seed, self.size(unknowns))
        )

    def back(self, unknowns, knowns, weights):
        return np.array(
            self.fmu.getAdjointDerivative(self.references(unknowns), self.references(knowns), weights, self.size(knowns))
        )

    def matrices(self, unknowns, knowns):
        """The Jacobian column by column, and row by row."""
        columns = [self.along(unknowns, knowns, seed) for seed in np.eye(self.size(knowns))]
        return np.stack(columns, axis=1), np.array([self.back(unknowns, knowns, w) for w in np.eye(self.size(unknowns))])


def states_and_rates(one):
    rates = [unknown.variable.name for unknown in one.description.derivatives]
    return [one.by_name[name].derivative.name for name in rates], rates


def test_both_products_are_the_kernels(both):
    one = Instance(both[0]).integrated()
    kernel = Kernel(MODELS[both[1]]())
    kernel.initialize()
    view, random = ContinuousView(kernel), np.random.default_rng(9)
    x = view.states + np.r_[random.normal(size=view.size - 2) * 0.03, 0.0, 0.0]
    view.set(0.0, x)
    one.fmu.setContinuousStates((c_double * len(x))(*x), len(x))
    d = Derivatives(view)
    d.look()
    states, rates = states_and_rates(one)
    inputs, outputs = one.names("input"), one.names("output")
    tunables = one.names("parameter", tunable=True)
    forward, backward = one.matrices(rates + outputs, states + inputs + tunables)
    first = kernel.first_output
    rows = [*range(d.derivatives.start, d.derivatives.stop), *(d.outputs.start + i - first for i in one.elements(outputs))]
    columns = [*range(view.size), *(view.size + i for i in one.elements(inputs + tunables))]
    right = d.matrix()[np.ix_(rows, columns)]
    assert np.array_equal(forward, right)
    assert np.abs(backward - right).max() <= 1e-13 * np.abs(right).max()
    assert not one.along(rates, ["time"], [1.0]).any()
    one.free()


def test_initialization_mode_of_both_kinds_differentiates_the_start(both):
    """Outputs by inputs, tunable and fixed parameters; of the adjoint products the same numbers."""
    for kind in (FMU3Model, FMU3Slave):
        one = Instance(both[0], kind).start(inside=True)
        inputs, outputs = one.names("input"), one.names("output")
        masses = [name for name in one.names("parameter") if name.endswith(".mass")]
        forward, backward = one.matrices(outputs, inputs + masses)
        assert np.abs(backward - forward).max() <= 1e-13 * np.abs(forward).max()
        for name in (inputs[0], masses[0]):
            at = one.size([*inputs, *masses][: [*inputs, *masses].index(name)])
            before, value = one.get(outputs), one.get([name])
            one.fmu.setFloat64(one.references([name]), [value[0] + 1e-6, *value[1:]])
            difference = (one.get(outputs) - before) / 1e-6
            assert difference == pytest.approx(forward[:, at], rel=1e-3, abs=1e-4)
            one.fmu.setFloat64(one.references([name]), list(value))
        one.free()


def test_outputs_of_co_simulation_hold_between_steps(both):
    """In Step Mode and Event Mode nothing that is set changes an output at once."""
    one = Instance(both[0], FMU3Slave, eventModeUsed=True).start()
    inputs, outputs = one.names("input"), one.names("output")
    tunables = one.names("parameter", tunable=True)
    for mode in ("event", "step"):
        if mode == "step":
            one.fmu.updateDiscreteStates()
            one.fmu.enterStepMode()
        before = one.get(outputs)
        forward, backward = one.matrices(outputs, inputs + tunables)
        assert not forward.any() and not backward.any() and forward.shape == backward.shape
        force = next(name for name in inputs if name.endswith(".force"))
        one.fmu.setFloat64(one.references([force]), [1.0] * one.span(force))
        assert np.array_equal(one.get(outputs), before)
    one.free()


@pytest.mark.parametrize("kind", [FMU3Model, FMU3Slave])
def test_what_is_refused_says_why(both, kind):
    one = Instance(both[0], kind, loggingOn=True)
    one = one.start() if kind is FMU3Slave else one.integrated()
    states = states_and_rates(one)[0]
    indicators = [name for name in one.names("local") if name.endswith(".event_indicators")]
    fixed = next(name for name in one.names("parameter") if name.endswith(".mass"))
    output = next(name for name in one.names("output") if name.endswith(".position"))
    force = next(name for name in one.names("input") if name.endswith(".force"))
    cases = [
        (indicators[:1], [force], "event indicators are not differentiated"),
        ([output], indicators[:1], "no Float64 variable has the value reference"),
        ([output], [fixed], "fixed after initialization"),
        ([output], [output], "computed, and no state"),
        (["time"], [force], "time is not computed"),
        ([force], [force], "is not computed"),
    ]
    if kind is FMU3Slave:
        cases.append(([output], states[:1], "states are the FMU's own in co-simulation"))
    for unknowns, knowns, words in cases:
        for product, seed in ((one.along, one.size(knowns)), (one.back, one.size(unknowns))):
            one.messages.clear()
            with pytest.raises(FMICallException):
                product(unknowns, knowns, [1.0] * seed)
            assert any(words in message for message in one.messages), (words, one.messages)
    with pytest.raises(FMICallException):
        one.fmu.getDirectionalDerivative(one.references([output]), one.references([force]), [1.0], one.span(output))
    with pytest.raises(FMICallException):
        one.fmu.getAdjointDerivative(one.references([output]), one.references([force]), [1.0] * one.span(output), 1)
    one.along([output], [force], [1.0] * one.span(force))
    one.free()
