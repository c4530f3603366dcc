"""Analytic derivatives of the continuous-time view, against differences, another linearisation and each other.

More random states than in the test, of every scene: ``python -m tests.kernel.test_derivatives 100``.
"""

from dataclasses import replace

import numpy as np
import pytest

from fmu_src.variables.interface import variables
from tensegrity_core.equilibria.linearization import at_rest, linearize
from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.kernel.derivatives import Derivatives
from tensegrity_core.scene import builtin_scenes
from tests.support import push, scene
from tests.support.derivative_states import Bench
from tests.support.driven_scenes import AFLOAT, LABORATORY, PENDULUM, RATED, built
from tests.support.element_scenes import STRINGS, mast
from tests.support.rigged_scenes import RIGGED
from tests.support.words import words

DRIVEN = {"laboratory": LABORATORY, "pendulum": PENDULUM, "afloat": AFLOAT, "rated": RATED, "rigged": RIGGED}
SEEN = 1e-7  # of what differences say


def model_of(name, law):
    found = scene(name) if name in builtin_scenes() else built(DRIVEN[name]) if name in DRIVEN else mast(name)
    return replace(found, damping_law=law)


def compare(bench):
    """All products at the state at hand.  Returns the largest difference, relative beside the round-off of differences, and how
    many knowns were compared."""
    d, kernel, n = bench.derivatives, bench.kernel, bench.view.size
    d.look()
    J, sizes, left, worst = d.matrix(), np.abs(bench.unknowns()), 0, 0.0
    knowns = [j for j in range(n + kernel.layout["bar_mass"].start) if d.differentiable(j)]
    for j in knowns:
        differences, h = bench.column(j)
        if bench.left:
            left += 1
            continue
        allowed = SEEN * np.abs(differences) + 2e-13 * (1.0 + sizes) / h + 1e-11
        off = np.abs(differences - J[:, j])
        assert np.all((off <= allowed) | (bench.kinked & np.isnan(off))), (
            j,
            np.flatnonzero(off > allowed),
            differences[off > allowed],
            J[off > allowed, j],
        )
        worst = max(worst, SEEN * np.nanmax(off / allowed))
    assert left <= 2
    d.look()
    for _ in range(3):
        seed, weights = bench.random.normal(size=d.knowns), bench.random.normal(size=d.unknowns)
        along, back = d.directional(seed), d.adjoint(weights)
        scale = np.abs(weights) @ np.abs(J) @ np.abs(seed)
        assert abs(weights @ along - back @ seed) <= 1e-14 * scale
        assert np.abs(along - J @ seed).max() <= 1e-13 * (np.abs(J) @ np.abs(seed)).max()
    return worst, len(knowns) - left


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("name", [*builtin_scenes(), *DRIVEN, *STRINGS])
def test_products_equal_differences(name, law):
    """At random states, on every piece of every law: to 1e-7, all unknowns by all states, inputs and tunable parameters."""
    model = model_of(name, law)
    bench = Bench(model)
    counts = [len(bench.kernel.breakpoints(s)) + 1 for s in range(len(model.strings))]
    for trial in range(max([*counts, 2])):
        bench.shake(trial)
        compare(bench)
    assert {(s, p) for s, p, _ in bench.pieces} == {(s, p) for s, count in enumerate(counts) for p in range(count)}


def at_start(kernel, view):
    """What is differentiated at the start, under the present values."""
    kernel.initialize()
    outputs = kernel.values[kernel.first_output :].copy()
    return np.concatenate([view.states, view.derivatives(), outputs, view.event_indicators()])


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar", *DRIVEN, "memory", "chain"])
def test_the_start_is_differentiated_by_start_values_and_fixed_parameters(name):
    """Masses move the centres of mass and the inertias, a moved node's velocity gives its bar an impulse."""
    kernel = Kernel(model_of(name, "literal"))
    view, random = ContinuousView(kernel), np.random.default_rng(5)
    d = Derivatives(view)
    for field in ("force", "rest_length_rate", "current", "drum_load", "node_velocity", "node_acceleration"):
        kernel[field][:] += random.normal(size=len(kernel[field]))
    kernel.initialize()
    d.look(start=True)
    J, sizes, kept = d.matrix(), np.abs(at_start(kernel, view)), kernel.values.copy()
    compared = 0
    for j in range(kernel.layout["position"].start):
        if not d.differentiable(view.size + j) or kernel.place(j)[0] in ("tolerance", "max_step", "nsh_Q", "nsh_zeta", "nsh_h"):
            continue
        found, h = [], 5e-5 if kernel.place(j)[0] in ("rest_length", "node_position") else 1e-3 * max(abs(kept[j]), 0.05)
        for step in (h, h / 2.0, h / 4.0):
            kernel.values[j] = kept[j] + step
            above = at_start(kernel, view)
            kernel.values[j] = kept[j] - step
            found.append((above - at_start(kernel, view)) / (2.0 * step))
            kernel.values[j] = kept[j]
        first, second = (4.0 * found[1] - found[0]) / 3.0, (4.0 * found[2] - found[1]) / 3.0
        differences, column = (16.0 * second - first) / 15.0, J[:, view.size + j]
        allowed = SEEN * np.abs(differences) + 2e-13 * (1.0 + sizes) / h + 1e-11
        assert (np.abs(differences - column) <= allowed).all(), (kernel.place(j), differences, column)
        compared += np.count_nonzero(column)
    assert compared > 10
    seed, weights = random.normal(size=d.knowns), random.normal(size=d.unknowns)
    scale = np.abs(weights) @ np.abs(J) @ np.abs(seed)
    assert abs(weights @ d.directional(seed) - d.adjoint(weights) @ seed) <= 1e-14 * scale


@pytest.mark.parametrize("name", ["two_bar_nsh", "snap"])
def test_the_start_is_differentiated_by_the_beams_of_honeycombs(name):
    """On every piece of the law: all standing, each of them snapping, some at their stop, bottomed out."""
    model = model_of(name, "literal")
    kernel, random = Kernel(model), np.random.default_rng(2)
    kernel.initialize()
    view = ContinuousView(kernel)
    d, string = Derivatives(view), min(model.honeycombs)
    length, scene_values = kernel["string_length"][string], kernel.values.copy()
    for piece in range(1, len(kernel.breakpoints(string)) + 1):
        kernel.values[:] = scene_values
        for field in ("nsh_Q", "nsh_zeta", "nsh_h"):
            kernel[field][:] *= random.uniform(0.96, 1.04, size=len(kernel[field]))
        kernel.initialize()
        ends = [*kernel.breakpoints(string), kernel.breakpoints(string)[-1] + 0.02]
        kernel["rest_length"][string] = length - random.uniform(
            *(ends[piece - 1 : piece + 1] @ np.array([[0.8, 0.2], [0.2, 0.8]]))
        )
        sizes, kept = np.abs(at_start(kernel, view)), kernel.values.copy()
        d.look(start=True)
        for field in ("nsh_Q", "nsh_zeta", "nsh_h"):
            for j in range(kernel.layout[field].start, kernel.layout[field].stop):
                found, h = [], 2e-5 * kept[j]
                for step in (h, h / 2.0):
                    kernel.values[j] = kept[j] + step
                    above = at_start(kernel, view)
                    kernel.values[j] = kept[j] - step
                    found.append((above - at_start(kernel, view)) / (2.0 * step))
                    kernel.values[j] = kept[j]
                right, column = (4.0 * found[1] - found[0]) / 3.0, d.directional(np.eye(d.knowns)[view.size + j])
                allowed = 1e-6 * np.abs(right) + 1e-11 * (1.0 + sizes) / h  # the curve is fitted to 1e-12
                wrong = np.abs(right - column)[: d.outputs.stop] > allowed[: d.outputs.stop]
                assert not wrong.any(), (
                    piece,
                    kernel.place(j),
                    right[: d.outputs.stop][wrong],
                    column[: d.outputs.stop][wrong],
                )


def test_accelerations_have_the_jacobian_of_implicit_methods():
    bench = Bench(model_of("laboratory", "literal"))
    bench.shake(1)
    d, kernel = bench.derivatives, bench.kernel
    d.look()
    Jq, Jv, _ = kernel.jacobian(kernel.state)
    plain = bench.half - len(bench.model.actuated)  # without the padding of the motors' blocks
    rates = slice(bench.view.size + bench.half, bench.view.size + bench.half + plain)
    J = d.matrix()[rates]
    assert np.abs(J[:, :plain] - Jq[:plain, :plain]).max() <= 1e-12 * np.abs(Jq).max()
    assert np.abs(J[:, bench.half : bench.half + plain] - Jv[:plain, :plain]).max() <= 1e-12 * np.abs(Jv).max()


@pytest.mark.parametrize("name", [*builtin_scenes(), "laboratory", "rigged"])
def test_outputs_by_inputs_are_those_of_the_linearisation(name):
    """`tc.linearize` differentiates the projected equations in NumPy, in minimal coordinates and by the exact laws."""
    model = model_of(name, "literal")
    linear = linearize(model, at_rest(model, push(model)))
    places = {row.name: row.reference for row in variables(model)}
    kernel = Kernel(model)
    kernel.initialize()
    view = ContinuousView(kernel)
    d = Derivatives(view)
    for quantity in linear.inputs:
        kernel.values[places[quantity.name]] = quantity.value
    d.look()
    rows = [d.outputs.start + places[quantity.name] - kernel.first_output for quantity in linear.outputs]
    columns = [view.size + places[quantity.name] for quantity in linear.inputs]
    differences = np.abs(d.matrix()[np.ix_(rows, columns)] - linear.D)
    assert differences.max() <= 1e-11 * np.abs(linear.D).max()


def test_a_derivative_of_an_input_takes_the_place_of_another():
    """Where a rest length has a slope, its rate counts no more."""
    kernel = Kernel(scene("three_bar"))
    kernel.initialize()
    d = Derivatives(ContinuousView(kernel))
    d.look()
    rates, tensions = d.known("rest_length_rate"), d.output("string_force")
    assert np.array_equal(np.diag(d.matrix()[tensions, rates]), -scene("three_bar").damping)
    kernel.slopes[0, kernel.layout["rest_length"].start] = 0.1
    d.look()
    assert np.array_equal(np.diag(d.matrix()[tensions, rates]), [0.0, *-scene("three_bar").damping[1:]])


def test_looking_changes_nothing_but_the_outputs():
    kernel = Kernel(scene("six_bar_nsh"))
    kernel.initialize()
    kernel.step(0.1)
    d = Derivatives(ContinuousView(kernel))
    before = kernel.save()
    with pytest.raises(InputError, match="initialize first"):
        kernel["force"][0] = 1.0
        d.look(start=True)
    kernel.restore(before)
    d.look()
    kernel["position"][:] = 0.0
    d.look()
    kernel.step(0.1)
    after = kernel.save()
    kernel.restore(before)
    kernel.step(0.1)
    one, other = np.frombuffer(kernel.save()[:-8], np.uint8), np.frombuffer(after[:-8], np.uint8)
    assert np.count_nonzero(one != other) <= 8  # the count of right-hand sides


def test_what_cannot_be_differentiated_is_refused():
    model = scene("three_bar_nsh")
    kernel = Kernel(model)
    view = ContinuousView(kernel)
    d = Derivatives(view)
    seed = np.zeros(d.knowns)
    with pytest.raises(InputError, match="initialize first"):
        d.look()
    with pytest.raises(InputError, match="differentiate first"):
        d.directional(seed)
    kernel.initialize()
    x = view.states
    x[len(x) // 2] = 1e300
    view.set(0.0, x)
    with pytest.raises(SimulationError):
        d.look()
    with pytest.raises(InputError, match="differentiate first"):
        d.adjoint(np.zeros(d.unknowns))
    kernel.initialize()
    d.look()
    with pytest.raises(SimulationError, match="not a finite number"):
        d.directional(seed + 1e308)
    with pytest.raises(InputError):
        d.directional(seed[1:])
    curves = [name for name in ("nsh_Q", "nsh_zeta", "nsh_h", "stiffness", "damping", "bar_mass") if
              not d.differentiable(d.known(name).start)]  # fmt: skip
    assert curves == []
    assert all(map(d.differentiated, range(d.unknowns)))
    memory = Derivatives(ContinuousView(Kernel(mast("memory"))))
    for field in ("stiffness", "nsh_Q", "nsh_zeta", "nsh_h"):
        assert not memory.differentiable(memory.known(field).start)


def main(states: int) -> None:
    for name in [*builtin_scenes(), *DRIVEN, *STRINGS]:
        for law in ("literal", "tension_only"):
            bench, worst, columns = Bench(model_of(name, law), seed=states), 0.0, 0
            for trial in range(states):
                bench.shake(trial)
                found, compared = compare(bench)
                worst, columns = max(worst, found), columns + compared
            on = f"{len(bench.pieces)} pieces of strings, clipped or not"
            print(f"{name} {law}: {states} states, {on}, {columns} knowns, largest difference {worst:.1e}", flush=True)


if __name__ == "__main__":
    main(*words(__doc__, int))
