"""ecos over ecospy: inputs by name before each step, or coupled: a source's outputs are the forces."""

from ecospy import EcosSimulation, EcosSimulationStructure
from job import finish, job

job = job()
with EcosSimulationStructure() as structure:
    for name, path in (("source", job.source), ("one", job.fmu))[not job.coupled :]:
        structure.add_model(name, path)
    for output, name in job.wires():
        structure.make_real_connection(f"source::{output}", f"one::{name}")
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
