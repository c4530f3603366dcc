"""libcosim (Open Simulation Platform) over libcosimpy: inputs by its override manipulator, or coupled: a source's outputs are
the forces."""

from job import finish, job
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

job = job()
execution = CosimExecution.from_step_size(step_size=job.step * 1e9)


def added(path, name):
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=path, instance_name=name))
    if slave < 0:
        raise SystemExit("libcosim did not take the FMU")
    return slave


source = added(job.source, "source") if job.coupled else None
slave = added(job.fmu, "one")
for output, name in job.wires():
    execution.connect_real_variables(source, job.source_outputs[output], slave, job.references[name])
manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
execution.add_manipulator(manipulator)
execution.add_observer(observer)
outputs, rows = [job.references[name] for name in job.outputs], []
for k in range(job.steps):
    if values := job.inputs(k):
        manipulator.slave_real_values(slave, [job.references[name] for name in values], list(values.values()))
    if not execution.step():
        raise SystemExit(f"libcosim could not take step {k}: {execution.status()}")
    rows.append(observer.last_real_values(slave, outputs))
finish(rows, first=1)
