"""libcosim (Open Simulation Platform) over libcosimpy: inputs by its override manipulator."""

from job import finish, job
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

job = job()
execution = CosimExecution.from_step_size(step_size=job.step * 1e9)
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=job.fmu, instance_name="one"))
if slave < 0:
    raise SystemExit("libcosim did not take the FMU")
manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
execution.add_manipulator(manipulator)
execution.add_observer(observer)
outputs, rows = [job.references[name] for name in job.outputs], []
for k in range(job.steps):
    values = job.inputs(k)
    manipulator.slave_real_values(slave, [job.references[name] for name in values], list(values.values()))
    if not execution.step():
        raise SystemExit(f"libcosim could not take step {k}: {execution.status()}")
    rows.append(observer.last_real_values(slave, outputs))
finish(rows, first=1)
