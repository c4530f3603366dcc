"""gemseo-fmu: a discipline that is executed step by step."""

from gemseo_fmu.disciplines.do_step_fmu_discipline import DoStepFMUDiscipline
from job import finish, job
from numpy import array

job = job()
names = list(job.inputs(0))
discipline = DoStepFMUDiscipline(
    job.fmu, input_names=names, output_names=job.outputs, initial_time=0.0, final_time=job.steps * job.step, time_step=job.step
)
rows = []
for k in range(job.steps):
    found = discipline.execute({name: array([value]) for name, value in job.inputs(k).items()})
    rows.append([found[name][0] for name in job.outputs])
finish(rows, first=1)
