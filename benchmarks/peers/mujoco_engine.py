"""MuJoCo (Todorov, Erez, Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012, DOI
10.1109/IROS.2012.6386109) on a problem that it can state: free bars, strings without dampers as spatial tendons."""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec

import numpy as np

from benchmarks.harness.problems import INSTANTS, Problem

from .ladder import Clock, Ladder, Run, fixed_steps, timed

INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")
#: Inertia of a thin bar about its own axis, which it never turns about, relative to that across; MuJoCo wants one.
AXIAL = 1e-5


def _document(problem: Problem, integrator: str, step: float) -> str:
    """The model in MJCF."""
    model, bodies, tendons = problem.model, [], []
    for n, (i, j) in enumerate(model.bars):
        mass, length = float(model.bar_mass[n]), float(model.bar_length[n])
        centre = " ".join(repr(float(x)) for x in 0.5 * (model.nodes[i] + model.nodes[j]))
        across = mass * length**2 / 12.0
        bodies.append(
            f'<body pos="{centre}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{across!r} {across!r} {AXIAL * across!r}"/>'
            f'<site name="n{i}" pos="0 0 {-0.5 * length!r}"/><site name="n{j}" pos="0 0 {0.5 * length!r}"/></body>'
        )
    for (i, j), k, rest in zip(model.strings, model.stiffness, model.rest_length):
        tendons.append(
            f'<spatial stiffness="{float(k)!r}" springlength="0 {float(rest)!r}">'
            f'<site site="n{i}"/><site site="n{j}"/></spatial>'
        )
    return (
        f'<mujoco><option integrator="{integrator}" timestep="{step!r}" gravity="0 0 {-model.gravity!r}">'
        f'<flag contact="disable"/></option><worldbody>{"".join(bodies)}</worldbody>'
        f"<tendon>{''.join(tendons)}</tendon></mujoco>"
    )


class Engine:
    """One model of MuJoCo with its start."""

    def __init__(self, problem: Problem, integrator: str, step: float):
        import mujoco

        self.mujoco, self.problem, self.step = mujoco, problem, step
        self.model = mujoco.MjModel.from_xml_string(_document(problem, integrator, step))
        self.data = mujoco.MjData(self.model)

    def begin(self) -> None:
        """Positions and velocities of the bars at the start: those of the centre, and turns in the bar's own axes."""
        mj, model, data = self.mujoco, self.problem.model, self.data
        mj.mj_resetData(self.model, data)
        for n, (i, j) in enumerate(model.bars):
            b = (model.nodes[j] - model.nodes[i]) / model.bar_length[n]
            quaternion, inverse, local = np.empty(4), np.empty(4), np.empty(3)
            mj.mju_quatZ2Vec(quaternion, b)
            data.qpos[7 * n + 3 : 7 * n + 7] = quaternion
            mj.mju_negQuat(inverse, quaternion)
            mj.mju_rotVecQuat(local, np.cross(b, model.velocity[j] - model.velocity[i]) / model.bar_length[n], inverse)
            data.qvel[6 * n : 6 * n + 3] = 0.5 * (model.velocity[i] + model.velocity[j])
            data.qvel[6 * n + 3 : 6 * n + 6] = local
        mj.mj_forward(self.model, data)

    def run(self, limit: float) -> np.ndarray:
        """(21, N, 3) m."""
        clock = Clock(limit)
        rows = [self.data.site_xpos.copy()]
        steps = round(self.problem.duration / INSTANTS / self.step)
        for _ in range(INSTANTS):
            self.mujoco.mj_step(self.model, self.data, nstep=steps)
            self.mujoco.mj_kinematics(self.model, self.data)
            rows.append(self.data.site_xpos.copy())
            clock()
        order = [self.model.site(f"n{i}").id for i in range(len(self.problem.model.nodes))]
        return np.array(rows)[:, order]


def _measure(problem: Problem, integrator: str, step: float, repetitions: int, limit: float) -> Run:
    engine = Engine(problem, integrator, step)
    found, position = timed(repetitions, engine.begin, partial(engine.run, limit))
    return found if position is None else Run(found.seconds, position, counts={"steps": round(problem.duration / step)})


def ladders(problem: Problem) -> list[Ladder]:
    """MuJoCo's integrators; none where it is not installed."""
    if find_spec("mujoco") is None:
        print("MuJoCo is missing (pip install mujoco); its rows are left out")
        return []
    return [Ladder("mujoco", name, False, "step", fixed_steps(), partial(_measure, problem, name)) for name in INTEGRATORS]
