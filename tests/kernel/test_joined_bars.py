"""The kernel's joints against the reference, closed forms and recorded structures.

Run as `python -m tests.kernel.test_joined_bars COUNT` it compares COUNT random structures.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tensegrity_core import kernel, reference, statics
from tensegrity_core.errors import SimulationError, TensegrityError
from tensegrity_core.fields import COUNTS, outputs
from tensegrity_core.kernel import simulate
from tensegrity_core.kernel.packing import fnv1a
from tensegrity_core.kernel.unpacking import from_bytes
from tensegrity_core.model import grid, held
from tensegrity_core.scene import load_scene
from tests.kernel.test_continuous import compare as host_against_reference
from tests.support import by_hand
from tests.support.jointed_scenes import random_forces, random_joints
from tests.support.words import words

STRUCTURES = Path(__file__).parents[1] / "structures"
TRAJECTORIES = ("motes_double_pendulum", "stedy_dbar", "stedy_ball", "tsg_jansen_leg", "tsg_dbar3d")


def framed(nodes, fixed, bars, **fields):
    return by_hand(nodes, fixed, bars, [], stiffness=[], rest_length=[], **{"gravity": 9.81} | fields)


def double_pendulum(**fields):
    return framed([[0, 0, 0], [1, 0, 0], [1.5, 0, -0.7]], [0], [(0, 1), (1, 2)], axes=(0, 2), bar_mass=[1.0, 2.0], **fields)


def chain(bars, planar=False):
    """Hangs slantwise from a fixed node, at rest."""
    along = np.arange(bars + 1)[:, None] / bars * np.array([1.0, 0.0 if planar else 0.5, -1.0])
    return framed(
        along, [0], [(i, i + 1) for i in range(bars)], axes=(0, 2) if planar else (0, 1, 2), bar_mass=np.full(bars, 1.0 / bars)
    )


def errors(result, expected):
    """By the names of the outputs: largest difference over 1 + the largest value.  How much energy went to and fro is counted
    by steps, and left out."""
    names = [field.name for field in outputs() if field.name != "throughput" and np.size(getattr(expected, field.name))]
    pairs = {name: (np.asarray(getattr(result, name)), np.asarray(getattr(expected, name))) for name in names}
    return {name: np.abs(one - other).max() / (1.0 + np.abs(other).max()) for name, (one, other) in pairs.items()}


def off_lengths(model, result):
    """The largest relative deviation of a bar's length."""
    ends = result.position[:, model.bars]
    return np.abs(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) / model.bar_length - 1.0).max(initial=0.0)


def ledger(result):
    total = result.kinetic + result.potential + result.elastic + result.dissipated - result.input_work
    return np.abs(total - total[0]).max() / max(1.0, result.throughput.max())


@pytest.mark.parametrize("method", ["dop853", "dopri5", "rodas5p", "radau9", "auto"])
def test_double_pendulum(method):
    """Over 2 s every output is the reference's."""
    model = double_pendulum()
    inputs = held(model, grid(2.0, 0.05))
    result = simulate(model, inputs, method)
    assert max(errors(result, reference.simulate(model, inputs)).values()) < 1e-8
    assert off_lengths(model, result) < 1e-14 and ledger(result) < 1e-8


def test_small_oscillations_of_the_double_pendulum():
    """Frequencies of thin rods from det(K - w^2 M) = 0 as eigenvalues of the kernel's Jacobian."""
    length, mass = 0.8, 1.5
    model = framed([[0, 0, 0], [0, 0, -length], [0, 0, -2 * length]], [0], [(0, 1), (1, 2)], axes=(0, 2), bar_mass=mass)
    M = mass * length**2 * np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]])
    K = mass * 9.81 * length * np.diag([1.5, 0.5])
    sim = kernel.Kernel(model)
    sim.initialize()
    Jq = sim.jacobian(sim.state)[0]
    found = np.sort(np.linalg.eigvals(-Jq).real)
    np.testing.assert_allclose(found[-2:], np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real), rtol=1e-12)
    np.testing.assert_allclose(found[:-2], 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_random_structures(seed):
    compare(seed, ("dop853", "radau9")[seed % 2])


def compare(seed, method):
    model = random_joints(seed)
    inputs = random_forces(model, seed)
    result = simulate(model, inputs, method)
    found = errors(result, reference.simulate(model, inputs))
    assert found["position"] < 1e-7 and max(found.values()) < 1e-5, (seed, found)
    assert off_lengths(model, result) < 1e-13, seed


@pytest.mark.parametrize("seed", [3, 10])
def test_strings_whose_mass_moves_like_a_bar(seed):
    """With the consistent mass matrix: couples nodes that no bar joins."""
    model = random_joints(seed)
    mass = np.linspace(0.1, 0.6, len(model.strings))
    model = dataclasses.replace(model, string_mass=mass, string_mass_matrix="consistent")
    inputs = random_forces(model, seed)
    assert max(errors(simulate(model, inputs), reference.simulate(model, inputs)).values()) < 1e-6
    packed = kernel.to_bytes(model)
    assert kernel.to_bytes(from_bytes(packed, model.node_names, model.bar_names, model.string_names, model.axes)) == packed


@pytest.mark.parametrize("seed", range(4))
def test_moved_nodes(seed):
    """Nodes that are fixed along some axes or all move with their bars and jump in velocity: positions, forces, energies."""
    model = random_joints((3, 9, 10, 22)[seed])
    moving = [int(node) for node in np.flatnonzero(model.held[:, model.axes].any(axis=1))]
    single = [
        (node, tuple(axes)) for node in moving if len(axes := [a for a in model.axes if model.held[node, a]]) < len(model.axes)
    ]
    model = dataclasses.replace(model, moving=moving, moving_axes=single)
    inputs = random_forces(model, seed)
    random = np.random.default_rng(seed)
    place, speed = np.zeros((5, len(moving), 3)), np.zeros((5, len(moving), 3))
    bend = random.normal(scale=2.0, size=place.shape)
    for k in range(1, 5):
        place[k] = place[k - 1] + 0.05 * speed[k - 1] + 0.5 * 0.05**2 * bend[k - 1]
        speed[k] = speed[k - 1] + 0.05 * bend[k - 1] + (0.2 * random.normal(size=bend[k].shape) if k == 2 else 0.0)
    inputs = dataclasses.replace(inputs, node_position=place + model.nodes[moving], node_velocity=speed, node_acceleration=bend)
    found = errors(simulate(model, inputs), reference.simulate(model, inputs))
    del found["velocity"]  # along the axes along which a node is moved the reference puts out none
    assert max(found.values()) < 1e-6


@pytest.mark.parametrize("method", ["dop853", "rodas5p"])
@pytest.mark.parametrize("seed", range(3))
def test_flat_welded_bodies(seed, method):
    """Straight and flat bodies, whose further nodes follow a frame."""
    random = np.random.default_rng(seed)
    flat = random.uniform(-1.0, 1.0, (5, 1 + seed % 2)) @ np.linalg.qr(random.normal(size=(3, 3)))[0][: 1 + seed % 2]
    nodes = np.vstack((flat, [[0.3, 0.4, -1.5], [1.5, 1.0, 1.2]]))
    bars = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)]
    model = by_hand(
        nodes, [0, 6] if seed else [6], bars, [(6, 3), (6, 5)], welds=[(0, 1, 2, 3)], gravity=9.81, stiffness=300.0, damping=4,
        rest_length=np.linalg.norm(nodes[[3, 5]] - nodes[6], axis=1) * 0.9, bar_mass=[1.0, 2.0, 0.5, 1.0, 0.7],
    )  # fmt: skip
    assert model.bodies[0].followers
    inputs = held(model, grid(0.25, 0.05))
    assert max(errors(simulate(model, inputs, method), reference.simulate(model, inputs)).values()) < 1e-6


@pytest.mark.parametrize("seed", (10, 22))
def test_saved_states(seed):
    """A saved state goes on to the last bit, in another simulation too."""
    sims = [kernel.Kernel(random_joints(seed)) for _ in range(2)]
    for sim in sims:
        sim.initialize()
    for _ in range(5):
        sims[0].step(0.01)
    sims[1].restore(sims[0].save())
    for sim in sims:
        for _ in range(5):
            sim.step(0.01)
    np.testing.assert_array_equal(*(sim.state for sim in sims))


@pytest.mark.parametrize("seed", (3, 10))
def test_a_host_that_integrates_by_itself(seed):
    """It reaches the reference, and its completed steps keep the lengths."""
    model = random_joints(seed)
    host_against_reference(model, random_forces(model, seed))


def test_redundant_bars():
    """A braced panel, two corners of it fixed: bar forces and reactions are those of least norm."""
    nodes = np.array([[0, 0, 0], [1, 0, 0.1], [1.1, 0, 1], [0, 0, 0.9], [1.7, 0, 1.6]])
    bars = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3), (2, 4)]
    model = framed(nodes, [0, 1], bars[1:], axes=(0, 2), bar_mass=[1.0, 2.0, 0.5, 1.5, 1.0, 0.7])
    assert model.redundant.any()
    inputs = held(model, grid(0.5, 0.1))
    result = simulate(model, inputs)
    assert max(errors(result, reference.simulate(model, inputs)).values()) < 1e-8
    assert np.ptp(result.bar_force[0]) > 1.0


def test_damaged_joints_are_refused():
    """Integers of the joints that are wrong are refused, or make another structure: never anything worse."""
    packed = [kernel.to_bytes(random_joints(seed)) for seed in (10, 12, 18)]
    random, refused = np.random.default_rng(5), 0
    for case in range(150):
        model = bytearray(packed[case % 3])
        first = 8 + 4 * int(random.integers(len(COUNTS), 200))
        model[first : first + 4] = int(random.choice([-1, 0, 1, 2, 3, 7, 100, 2**31 - 1])).to_bytes(4, "little", signed=True)
        body = bytes(model[:-8])
        try:
            sim = kernel.Kernel(body + fnv1a(body).to_bytes(8, "little"))
            sim.initialize()
            sim.step(1e-3)
        except TensegrityError:
            refused += 1
    assert 50 < refused < 150


@pytest.mark.parametrize("seed", range(12))
def test_packed_joints_come_back(seed):
    model = random_joints(seed)
    packed = kernel.to_bytes(model)
    found = from_bytes(packed, model.node_names, model.bar_names, model.string_names, model.axes)
    assert kernel.to_bytes(found) == packed
    assert (found.partly_fixed, found.moving_axes, found.welds) == (model.partly_fixed, model.moving_axes, model.welds)


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_published_structures(name):
    """Released under gravity they move as the reference says."""
    model = dataclasses.replace(statics.build_model(load_scene(STRUCTURES / f"{name}.toml")), gravity=9.81)
    inputs = held(model, grid(0.5, 0.05))
    result = simulate(model, inputs)
    assert errors(result, reference.simulate(model, inputs))["position"] < 1e-7
    assert off_lengths(model, result) < 1e-13 and ledger(result) < 1e-8


@pytest.mark.parametrize("method", ["dop853", "rodas5p"])
def test_lengths_stay(method):
    """A chain that swings: to round-off at every point, whatever the tolerance."""
    model = chain(6)
    result = simulate(model, held(model, grid(10.0, 0.1)), method, tolerance=1e-6)
    assert off_lengths(model, result) < 1e-13


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("ros2", 2)])
def test_order(method, order):
    model = double_pendulum()
    inputs = held(model, grid(0.5, 0.1))
    exact = simulate(model, inputs, "dop853", tolerance=1e-13).position
    found = [np.abs(simulate(model, inputs, method, max_step=0.1 / n).position - exact).max() for n in (32, 64)]
    assert abs(np.log2(found[0] / found[1]) - order) < 0.25


def test_work_grows_with_the_chain():
    """The factor of a chain has as many blocks per bar, however long it is: memory shows it."""
    size = {bars: kernel.Kernel(chain(bars)).memory_size for bars in (100, 400, 1600)}
    assert size[1600] / size[400] < 4.1 and size[400] / size[100] < 4.1


def test_chain_pulled_straight():
    """An end of two bars is moved away until they are straight: there the motion has no next step, the kernel says so, and its
    last good state stays."""
    nodes = [[0, 0, 0], [0.95, 0, -np.sqrt(1 - 0.95**2)], [1.9, 0, 0]]
    model = framed(nodes, [0, 2], [(0, 1), (1, 2)], axes=(0, 2), moving=(2,))
    sim = kernel.Kernel(model)
    sim["node_velocity"][:] = 0.2, 0.0
    sim.initialize()
    with pytest.raises(SimulationError, match="constraints of the bars lock"):
        for _ in range(100):
            sim.take_inputs()
            sim["node_position"][:] = 1.9 + 0.2 * sim.time, 0.0
            sim.step(0.01)
    assert 0.45 < sim.time < 0.51 and np.isfinite(sim.state).all()
    assert np.abs(np.linalg.norm(sim["position"].reshape(-1, 2)[1]) - 1.0) < 1e-12


if __name__ == "__main__":
    (count,) = words(__doc__, int)
    for number in range(count):
        compare(number, ("dop853", "radau9")[number % 2])
    print(f"{count} random structures agree")
