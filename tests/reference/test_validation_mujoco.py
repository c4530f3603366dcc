"""Validation against an independent engine: MuJoCo on the three-bar prism (150 degrees twist), undamped strings.

Bars of 1 kg and 0.695 m, strings of 1000 N/m.  The prism floats freely, starts with every bar moving, and its strings go
slack and taut again; without damping nothing jumps, so that MuJoCo's RK4 converges.
"""

import mujoco
import numpy as np
import pytest

from tensegrity_core import kernel, reference
from tensegrity_core.model import Model, grid, held
from tests.support import by_hand

LENGTH, STIFFNESS, MASS, PRESTRESS = 0.695, 1000.0, 1.0, 2.0


def prism() -> Model:
    """Radius and height chosen so that the bars have their length; prestress: tension of the verticals, N."""
    twist = np.radians(150.0)
    radius = 0.25
    chord = 2.0 * radius * np.sin(twist / 2.0)
    height = np.sqrt(LENGTH**2 - chord**2)
    low = np.arange(3) * 2.0 * np.pi / 3.0
    bottom = np.column_stack([radius * np.cos(low), radius * np.sin(low), np.zeros(3)])
    top = np.column_stack([radius * np.cos(low + twist), radius * np.sin(low + twist), np.full(3, height)])
    nodes = np.vstack([bottom, top])
    bars = [(i, 3 + i) for i in range(3)]
    sides = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)]
    verticals = [(i, 3 + (i - 1) % 3) for i in range(3)]
    strings = np.array(sides + verticals)
    length = np.linalg.norm(nodes[strings[:, 1]] - nodes[strings[:, 0]], axis=1)
    density = np.where(np.arange(9) < 6, 1.0 / np.sqrt(3.0), 1.0) * PRESTRESS / length[6]
    velocity = np.zeros((6, 3))
    for n, (i, j) in enumerate(bars):
        b = nodes[j] - nodes[i]
        spin = np.cross([1.3 - n, -0.7 + n, 0.9], b)
        velocity[i], velocity[j] = -spin + [0.1 * n, 0.2, -0.1], spin + [0.1 * n, 0.2, -0.1]
    rest = length - density * length / STIFFNESS
    return by_hand(nodes, [], bars, strings, bar_mass=MASS, stiffness=STIFFNESS, rest_length=rest, velocity=velocity)


def mujoco_positions(model: Model, duration: float, step: float) -> np.ndarray:
    """(6, 3) m: the end positions as MuJoCo computes them."""
    bodies, tendons = [], []
    for n, (i, j) in enumerate(model.bars):
        centre = (0.5 * (model.nodes[i] + model.nodes[j])).tolist()
        across = MASS * LENGTH**2 / 12.0
        bodies.append(
            f'<body name="b{n}" pos="{centre[0]!r} {centre[1]!r} {centre[2]!r}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{MASS}" diaginertia="{across!r} {across!r} 1e-6"/>'
            f'<site name="n{i}" pos="0 0 {-LENGTH / 2!r}"/><site name="n{j}" pos="0 0 {LENGTH / 2!r}"/></body>'
        )
    for (i, j), rest in zip(model.strings, model.rest_length):
        tendons.append(
            f'<spatial stiffness="{STIFFNESS}" springlength="0 {float(rest)!r}">'
            f'<site site="n{i}"/><site site="n{j}"/></spatial>'
        )
    text = (
        f'<mujoco><option integrator="RK4" timestep="{step!r}" gravity="0 0 0"><flag contact="disable"/></option>'
        f"<worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )
    engine = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(engine)
    for n, (i, j) in enumerate(model.bars):
        b = (model.nodes[j] - model.nodes[i]) / LENGTH
        quaternion = np.empty(4)
        mujoco.mju_quatZ2Vec(quaternion, b)
        data.qpos[7 * n + 3 : 7 * n + 7] = quaternion
        spin = np.cross(b, model.velocity[j] - model.velocity[i]) / LENGTH
        local, inverse = np.empty(3), np.empty(4)
        mujoco.mju_negQuat(inverse, quaternion)
        mujoco.mju_rotVecQuat(local, spin, inverse)
        data.qvel[6 * n : 6 * n + 3] = 0.5 * (model.velocity[i] + model.velocity[j])
        data.qvel[6 * n + 3 : 6 * n + 6] = local
    mujoco.mj_step(engine, data, nstep=round(duration / step))
    mujoco.mj_forward(engine, data)
    return np.array([data.site(f"n{i}").xpos for i in range(6)])


def test_mujoco_converges_to_our_motion():
    model, duration = prism(), 0.5
    inputs = held(model, grid(duration, duration))
    ours = kernel.simulate(model, inputs, tolerance=1e-12)
    assert len(ours.transitions) >= 10, "the strings must go slack and taut for this to prove anything"
    coarse, fine = (np.abs(mujoco_positions(model, duration, h) - ours.position[-1]).max() for h in (4e-4, 2e-5))
    assert fine < 1e-7
    assert coarse > 20.0 * fine, "MuJoCo's error must shrink with its step"


def test_the_reference_agrees_on_the_prism():
    model = prism()
    inputs = held(model, grid(0.5, 0.5))
    a, b = kernel.simulate(model, inputs), reference.simulate(model, inputs)
    assert np.abs(a.position - b.position).max() < 1e-9


@pytest.mark.parametrize("method", ["dop853", "rodas5p"])
def test_energy_drift_over_10_s(method):
    model = prism()
    run = kernel.simulate(model, held(model, grid(10.0, 0.5)), method=method, tolerance=1e-10)
    energy = run.kinetic + run.elastic
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-7
