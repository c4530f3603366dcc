"""fmpy.simulate_fmu, which takes inputs as a table: two rows at the instant of a jump.  Model exchange: by its CVODE."""

import numpy as np
from fmpy import simulate_fmu
from job import finish, job

#: Relative tolerance of CVODE.
TOLERANCE = 1e-10

job = job()
h = job.step


def row(t, k):
    return (t, *(np.array(value) if isinstance(value, list) else value for value in job.whole(job.inputs(k)).values()))


rows = [row(0.0, 0)]
for k in range(1, job.steps):
    if job.inputs(k - 1) != job.inputs(k):
        rows += [row(k * h, k - 1), row(k * h, k)]
rows.append(row(job.steps * h, job.steps - 1))
given = job.whole(job.inputs(0))
types = [(name, float, (len(value),)) if isinstance(value, list) else (name, float) for name, value in given.items()]
found = simulate_fmu(
    job.fmu,
    stop_time=job.steps * h,
    step_size=h,
    output_interval=h,
    relative_tolerance=TOLERANCE if job.kind == "me" else None,
    record_events=False,
    input=np.array(rows, dtype=[("time", float), *types]),
    output=job.whole_outputs(),
    start_values={} if job.arrays else job.starts,
    fmi_type="ModelExchange" if job.kind == "me" else "CoSimulation",
)
finish([np.concatenate([np.ravel(x) for x in list(one)[1:]]) for one in found])
