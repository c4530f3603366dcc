"""libcosim (Open Simulation Platform) over libcosimpy: an unpacked SSP, its fixed-step algorithm.  See job.py."""

from job import finish, job
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver

told = job()
execution = CosimExecution.from_ssp_file(ssp_path=told["folder"], step_size=round(told["step"] * 1e9))
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
structure = execution.slave_index_from_instance_name(told["unit"])
rows = []
for k in range(told["steps"]):
    if not execution.step():
        raise SystemExit(f"libcosim could not take step {k}: {execution.status()}")
    rows.append(observer.last_real_values(structure, told["references"]))
finish(rows)
