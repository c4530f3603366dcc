"""ecos over ecospy: an SSP, its fixed-step algorithm.  See job.py."""

from ecospy import EcosSimulation
from job import finish, job

told = job()
with EcosSimulation(ssp_path=told["ssp"], step_size=told["step"]) as simulation:
    simulation.init(parameter_set=told["parameters"])
    rows = []
    for _ in range(told["steps"]):
        simulation.step()
        rows.append([simulation.get_real(f"{told['unit']}::{name}") for name in told["outputs"]])
    simulation.terminate()
finish(rows)
