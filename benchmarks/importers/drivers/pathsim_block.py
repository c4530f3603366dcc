"""PathSim: an FMU block between source blocks.

Co-simulation: the block makes the step that starts at t in its event at t and then shows the outputs of t + h: so its outputs
are read here from the block itself, after each of its events.  Model exchange: by an explicit method of order 8.
"""

from job import finish, job
from pathsim import Connection, Simulation
from pathsim.blocks import Source
from pathsim.solvers import RKDP87
from pathsim_fmi import CoSimulationFMU, ModelExchangeFMU

#: Of the method of model exchange, relative and absolute.
TOLERANCE = 1e-9

job = job()


class Block(ModelExchangeFMU):
    """PathSim asks a block whether inputs reach its outputs at once by varying them about zero: no rest length is negative."""

    def __len__(self):
        return 1


class Clock:
    """The step that is under way."""

    k = 0


def signal(name):
    def value(t):
        return job.inputs(Clock.k).get(name, job.starts.get(name, 0.0))

    return value


def names(block, causality):
    return [v.name for v in block.fmu_wrapper.model_description.modelVariables if v.causality == causality]


def connected(block):
    sources = [Source(signal(name)) for name in names(block, "input")]
    return [*sources, block], [Connection(source[0], block[i]) for i, source in enumerate(sources)]


def row(block):
    outputs = names(block, "output")
    return [float(block.outputs.to_array()[outputs.index(name)]) for name in job.outputs]


def stepped():
    block = CoSimulationFMU(job.fmu, instance_name="one", start_values=start(), dt=job.step)
    rows, step = [row(block)], block.events[0].func_act

    def recorded(t):
        step(t)
        rows.append(row(block))
        Clock.k = min(Clock.k + 1, job.steps - 1)

    block.events[0].func_act = recorded
    simulation = Simulation(*connected(block), dt=job.step, log=False)
    simulation.run(job.steps * job.step - 0.5 * job.step)
    finish(rows[: job.steps + 1])


def integrated():
    block = Block(job.fmu, instance_name="one", start_values=start(), tolerance=1e-12)
    accuracy = {"tolerance_lte_abs": TOLERANCE, "tolerance_lte_rel": TOLERANCE}
    simulation = Simulation(*connected(block), dt=1e-4, Solver=RKDP87, log=False, **accuracy)
    rows = []
    for Clock.k in range(job.steps):
        simulation.run(job.step, reset=False, adaptive=True)
        rows.append(row(block))
    finish(rows, first=1)


def start():
    return {} if job.arrays else dict(job.starts)


if job.kind == "me":
    integrated()
else:
    stepped()
