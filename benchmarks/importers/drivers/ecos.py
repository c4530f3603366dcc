"""ecos over ecospy: inputs by name before each step."""

from ecospy import EcosSimulation, EcosSimulationStructure
from job import finish, job

job = job()
with EcosSimulationStructure() as structure:
    structure.add_model("one", job.fmu)
    simulation = EcosSimulation(structure=structure, step_size=job.step)
with simulation:
    simulation.init()
    rows = [[simulation.get_real(f"one::{name}") for name in job.outputs]]
    for k in range(job.steps):
        for name, value in job.inputs(k).items():
            simulation.set_real(f"one::{name}", value)
        simulation.step()
        rows.append([simulation.get_real(f"one::{name}") for name in job.outputs])
    simulation.terminate()
finish(rows)
