"""PathSim: an FMU block between source blocks and a recorder.  The block makes the step that starts at t in its event at t and
then shows the outputs of t + h: so its outputs are read here from the block itself, after each of its events."""

from job import finish, job
from pathsim import Connection, Simulation
from pathsim.blocks import Source
from pathsim_fmi import CoSimulationFMU

job = job()
block = CoSimulationFMU(job.fmu, instance_name="one", start_values=dict(job.starts), dt=job.step)
inputs = [v.name for v in block.fmu_wrapper.model_description.modelVariables if v.causality == "input"]
outputs = [v.name for v in block.fmu_wrapper.model_description.modelVariables if v.causality == "output"]
chosen = [outputs.index(name) for name in job.outputs]


def signal(name):
    def value(t):
        return job.inputs(min(int(t / job.step + 1e-6), job.steps - 1)).get(name, job.starts[name])

    return value


sources = [Source(signal(name)) for name in inputs]
wires = [Connection(source[0], block[i]) for i, source in enumerate(sources)]
rows, step = [[float(block.outputs.to_array()[i]) for i in chosen]], block.events[0].func_act


def recorded(t):
    step(t)
    rows.append([float(block.outputs.to_array()[i]) for i in chosen])


block.events[0].func_act = recorded
simulation = Simulation([*sources, block], wires, dt=job.step, log=False)
simulation.run(job.steps * job.step - 0.5 * job.step)
finish(rows[: job.steps + 1])
