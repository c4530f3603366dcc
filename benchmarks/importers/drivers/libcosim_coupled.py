"""libcosim couples two FMUs: a source's outputs are the forces."""

from job import finish, job
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

job = job()
execution = CosimExecution.from_step_size(step_size=job.step * 1e9)
source = execution.add_local_slave(CosimLocalSlave(fmu_path=job.source, instance_name="source"))
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=job.fmu, instance_name="one"))
if slave < 0 or source < 0:
    raise SystemExit("libcosim did not take the FMU")
for output, name in job.wires():
    execution.connect_real_variables(source, job.source_outputs[output], slave, job.references[name])
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
outputs, rows = [job.references[name] for name in job.outputs], []
for k in range(job.steps):
    if not execution.step():
        raise SystemExit(f"libcosim could not take step {k}: {execution.status()}")
    rows.append(observer.last_real_values(slave, outputs))
finish(rows, first=1)
