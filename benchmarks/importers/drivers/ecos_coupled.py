"""ecos couples two FMUs: a source's outputs are the forces."""

from ecospy import EcosSimulation, EcosSimulationStructure
from job import finish, job

job = job()
with EcosSimulationStructure() as structure:
    structure.add_model("source", job.source)
    structure.add_model("one", job.fmu)
    for output, name in job.wires():
        structure.make_real_connection(f"source::{output}", f"one::{name}")
    simulation = EcosSimulation(structure=structure, step_size=job.step)
with simulation:
    simulation.init()
    rows = [[simulation.get_real(f"one::{name}") for name in job.outputs]]
    for _k in range(job.steps):
        simulation.step()
        rows.append([simulation.get_real(f"one::{name}") for name in job.outputs])
    simulation.terminate()
finish(rows)
