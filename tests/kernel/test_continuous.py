"""The kernel's continuous-time view under solvers of SciPy, against the reference."""

from dataclasses import replace

import numpy as np
import pytest

from fmu_src.validation.scenarios import scenarios
from tensegrity_core import reference
from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.fields import FIELDS
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import DISCRETE_CHANGED, STATES_CHANGED, ContinuousView
from tensegrity_core.model import grid, held
from tensegrity_core.model.components import flattened
from tensegrity_core.reference import instant
from tensegrity_core.reference.structure import Structure
from tensegrity_core.scene import builtin_scenes
from tests.support import changed, push, scene
from tests.support.continuous_host import Host
from tests.support.driven_scenes import LABORATORY, built
from tests.support.element_scenes import MAST

POSITION = next(field for field in FIELDS if field.name == "position")


def started(model):
    kernel = Kernel(model)
    kernel.initialize()
    return kernel, ContinuousView(kernel)


def compare(model, inputs, method="DOP853", position=1e-8, energy=1e-5, tolerance=1e-11):
    """Positions and energies of a run by SciPy and the reference, and that both saw the same transitions."""
    host, theirs = Host(model, inputs, method, tolerance).run(), reference.simulate(model, inputs)
    given = np.array([flattened(POSITION, model, row[None])[0] for row in theirs.position])
    assert np.abs(host.series("position") - given).max() < position
    for name in ("dissipated", "input_work", "elastic", "kinetic"):
        assert np.abs(host.series(name)[:, 0] - getattr(theirs, name)).max() < energy, name
    ours = [(t.string, t.before, t.after) for t in host.transitions]
    assert sorted(ours) == sorted((t.string, t.before, t.after) for t in theirs.transitions)
    assert host.lengths < 1e-9
    return host, theirs


@pytest.mark.parametrize("name", builtin_scenes())
def test_a_solver_outside_reaches_the_reference(name):
    model = scene(name)
    weak = next(s for s in scenarios(model, 0.6, 0.05) if s.name == "square_wave_0_1d")
    host, _ = compare(weak.model, weak.inputs)
    assert host.transitions


def test_a_stiff_solver_outside_reaches_the_reference():
    model = scene("three_bar_nsh")
    stiff = next(s for s in scenarios(model, 0.6, 0.05) if s.name == "square_wave_1d")
    compare(stiff.model, stiff.inputs, method="Radau", position=1e-7)


def test_clipped_strings_and_their_energy():
    model = replace(changed(scene("three_bar"), 500), damping_law="tension_only")
    wave = next(s for s in scenarios(model, 0.6, 0.05) if s.name == "square_wave_1d")
    compare(wave.model, wave.inputs, energy=1e-4)


@pytest.mark.parametrize("kind", ["memory", "bistable"])
def test_snaps_of_strings_with_memory(kind):
    model = built(MAST, strings={"s1": {"nodes": ["n3", "n2"], "nsh": kind, "stiffness": 4000.0, "damping": 8.0},
                                 "s2": {"nodes": ["n4", "n2"], "material": "cable"}},
                  prestress={"tension": {"s1": 2.0}})  # fmt: skip
    force = np.zeros((len(model.nodes), 3))
    force[1, 0] = 40.0
    inputs = held(model, grid(1.0, 0.05), force=lambda t: force * np.sin(8.0 * t))
    host, theirs = compare(model, inputs, position=1e-7)
    assert sum(t.loss for t in host.transitions) == pytest.approx(sum(t.loss for t in theirs.transitions), abs=1e-8)
    assert any(t.loss > 0.0 for t in host.transitions)


def test_what_drives_loads_and_slows_down_a_structure():
    model = built(LABORATORY)
    drives = next(s for s in scenarios(model, 0.4, 0.02) if s.name == "drives_1d")
    compare(drives.model, drives.inputs, position=1e-7)


def test_jumps_of_rest_lengths_are_work_of_the_input():
    model = changed(scene("three_bar_nsh"), 50)
    inputs = held(model, grid(0.4, 0.05), rest_length=lambda t: model.rest_length * (1.05 if 0.1 < t < 0.3 else 0.97))
    inputs = replace(inputs, rest_length_rate=np.zeros_like(inputs.rest_length))
    compare(model, inputs)


def motion_of(kernel, view, model):
    """Positions and velocities (3, n) m, m/s at the present state."""
    view.outputs()
    axes, n = list(model.axes), len(model.nodes)
    N, Ndot = model.nodes.T.copy(), np.zeros((3, n))
    N[axes] = kernel["position"].reshape(n, -1).T
    Ndot[np.ix_(axes, model.free_nodes)] = kernel["velocity"].reshape(len(model.free_nodes), -1).T
    return N, Ndot


def within(ends, piece, random):
    """An elongation on a piece, m."""
    low, high = ends[piece - 1] if piece else ends[0] - 0.02, ends[piece] if piece < len(ends) else ends[-1] + 0.02
    return random.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low))


def resolved(model, force, kernel):
    """The inputs that the kernel has, for the reference."""
    rest, rate = kernel["rest_length"][None].copy(), kernel["rest_length_rate"][None].copy()
    inputs = held(model, grid(1.0, 1.0), force=lambda t: force)
    return replace(inputs, rest_length=rest, rest_length_rate=rate).resolved(model)


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("name", builtin_scenes())
def test_derivatives_equal_the_references_equations(name, law):
    """At random states, on whatever pieces these are: accelerations and powers to round-off."""
    model = replace(scene(name), damping_law=law)
    kernel, view = started(model)
    random, s, axes = np.random.default_rng(7), Structure(model), list(model.axes)
    half, n = (view.size - 2) // 2, len(model.nodes)
    x0, pieces = view.states, set()

    def places(x):
        view.set(0.0, x)
        view.outputs()
        return kernel["position"].copy()

    origin = places(x0)
    spread = np.array([places(x0 + step) - origin for step in np.eye(view.size)[:half]]).T
    counts = [len(ends) + 1 for ends in s.breakpoints]
    for trial in range(max(counts) + 8):
        x = x0 + np.concatenate((random.normal(size=half) * 0.12, random.normal(size=half), [0.0, 0.0]))
        kernel["force"][:] = random.normal(size=len(kernel["force"])) * 30.0
        kernel["rest_length_rate"][:] = random.normal(size=len(counts)) * 0.3
        view.set(0.0, x)
        view.enter_event()
        view.update_discrete()  # bars on their lengths
        N, Ndot = motion_of(kernel, view, model)
        _, xi, _ = instant.string_motion(N, Ndot, s.C_s)
        kernel["rest_length"][:] = xi - [
            within(ends, (trial + i) % m, random) for i, (ends, m) in enumerate(zip(s.breakpoints, counts))
        ]
        view.enter_event()
        view.update_discrete()  # strings on their pieces
        dx = view.derivatives()
        force = np.zeros((n, 3))
        force[np.ix_(model.free_nodes, axes)] = kernel["force"].reshape(-1, len(axes))
        load = instant.load_of(s, resolved(model, force, kernel), 0)
        piece = np.array([np.searchsorted(ends, e) for ends, e in zip(s.breakpoints, xi - kernel["rest_length"])])
        mode = instant.mode_of(s, piece, np.zeros(len(piece), bool))
        if law == "tension_only":
            clipped = (piece > 0) & (instant.strings_at(s, load, mode, 0.0, N, Ndot).unclipped < 0.0)
            mode = instant.mode_of(s, piece, clipped)
        motion = instant.motion_at(s, load, mode, 0.0, N, Ndot)
        expected = motion.Nddot[axes].T.ravel()
        assert np.abs(spread @ dx[half : 2 * half] - expected).max() <= 1e-10 * (1.0 + np.abs(expected).max())
        put_in, lost, size = instant.powers(s, load, motion, Ndot)
        assert np.abs(dx[-2:] - [lost, put_in]).max() <= 1e-11 * (1.0 + size)
        pieces |= set(enumerate(piece.tolist()))
    assert pieces == {(i, p) for i, n in enumerate(counts) for p in range(n)}


def test_indicators_do_not_call_back_at_once():
    """After an event every indicator is positive, and no further event changes anything."""
    _, view = started(scene("three_bar_nsh"))
    random, half = np.random.default_rng(3), (view.size - 2) // 2
    for _ in range(200):
        x = view.states
        x[: 2 * half] += random.normal(size=2 * half) * 0.05
        view.set(0.0, x)
        view.enter_event()
        view.update_discrete()
        assert view.event_indicators().min() > 0.0
        assert view.update_discrete() == 0


def test_symmetric_strings_leave_their_pieces_in_one_event():
    """The scene's coordinates are rounded to mm; made exactly threefold, its strings change in threes."""
    model = changed(scene("three_bar"), 50)
    nodes, rest = model.nodes.copy(), model.rest_length.copy()
    third = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1.0]])
    for base, image in ((0, 1), (1, 2), (3, 5), (5, 4)):
        nodes[image] = third @ nodes[base]
    model = replace(model, nodes=nodes, rest_length=np.repeat(rest[[0, 3]], 3))
    force = push(model, -60.0, 0.0)
    host = Host(model, held(model, grid(0.2, 0.2), force=lambda t: force)).run()
    times = np.array([t.time for t in host.transitions])
    assert len(times) >= 6 and len(times) % 3 == 0
    assert np.ptp(times.reshape(-1, 3), axis=1).max() == 0.0


@pytest.mark.parametrize(("part", "steps"), [(1e-9, 1), (1e-8, 2), (1e-3, 32)])
def test_bars_that_drifted_ask_for_an_event_and_get_their_lengths_back(part, steps):
    """At once from a solver that keeps them well; from another after some steps, so that it is not restarted at each."""
    _, view = started(scene("six_bar"))
    assert not any(view.completed_step() for _ in range(100))
    view.enter_event()
    view.update_discrete()
    x = view.states
    x[: (view.size - 2) // 2] *= 1.0 + part
    view.set(0.0, x)
    asked = [view.completed_step() for _ in range(steps + 1)]
    assert asked.index(True) == steps - 1 and asked[-1]
    view.enter_event()
    assert view.update_discrete() & STATES_CHANGED
    assert not view.completed_step() and view.update_discrete() == 0


def test_nominal_rates_are_speeds_of_the_strings():
    """g sqrt(m / k), between a hundredth of the speed of a fall over the extent and that speed."""
    model = scene("three_bar")
    fall = np.sqrt(9.81 * model.bar_length.max())
    for stiffness, speed in ((5000.0, 9.81 / np.sqrt(5000.0)), (1e9, 0.01 * fall), (1e-3, fall)):
        one = replace(model, stiffness=np.array([1e-3] * 5 + [stiffness]))
        nominals = ContinuousView(Kernel(one)).nominals
        half = len(nominals) // 2 - 1
        np.testing.assert_allclose(nominals[:half], model.bar_length.max(), rtol=1e-12)
        np.testing.assert_allclose(nominals[half : 2 * half], speed, rtol=1e-12)


def test_a_saved_state_holds_the_pieces():
    model = scene("three_bar_nsh")
    kernel, view = started(model)
    view.enter_event()
    kernel["rest_length"][:] *= 0.98
    assert view.update_discrete() & DISCRETE_CHANGED
    saved, dx, z = kernel.save(), view.derivatives(), view.event_indicators()
    kernel["rest_length"][:] *= 1.2
    view.update_discrete()
    assert not np.array_equal(z, view.event_indicators())
    other, its_view = started(model)
    for k, v in ((kernel, view), (other, its_view)):
        k.restore(saved)
        assert np.array_equal(v.derivatives(), dx) and np.array_equal(v.event_indicators(), z)


def test_what_cannot_be_is_refused_and_changes_nothing():
    kernel = Kernel(scene("three_bar_nsh"))
    view = ContinuousView(kernel)
    for call in (view.derivatives, view.event_indicators, view.outputs, view.enter_event, view.update_discrete):
        with pytest.raises(InputError):
            call()
    kernel.initialize()
    x = view.states
    for wrong in (np.nan, np.inf):
        with pytest.raises(InputError):
            view.set(wrong, x)
        with pytest.raises(InputError):
            view.set(0.0, np.where(np.arange(len(x)) == 3, wrong, x))
    view.enter_event()
    before = kernel.save()
    mass = kernel["bar_mass"].copy()
    kernel["bar_mass"][0] = 2.0
    with pytest.raises(InputError, match="is fixed"):
        view.update_discrete()
    kernel["bar_mass"][:] = mass
    kernel["rest_length"][0] = -1.0
    with pytest.raises(InputError):
        view.update_discrete()
    kernel.restore(before)
    assert np.array_equal(view.states, x) and kernel.save() == before
    far = x.copy()
    far[len(x) // 2] = 1e300
    view.set(0.0, far)
    with pytest.raises(SimulationError):
        view.derivatives()
