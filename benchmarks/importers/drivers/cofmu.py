"""CoFmuPy: inputs as literal streams held between their instants.  It wants every input connected."""

from cofmupy import Coordinator
from job import finish, job

job = job()


def stream(name):
    if name == job.wave:
        return {f"{(k - 0.5) * job.step if k else 0.0:.6f}": value for k, value in enumerate(job.values)}
    return {"0": job.constants.get(name, job.starts[name])}


connections = [
    {
        "source": {"id": f"s{i}", "type": "literal", "values": stream(name)},
        "target": {"id": "one", "type": "fmu", "variable": name},
    }
    for i, name in enumerate(job.starts)
]
config = {
    "fmus": [{"id": "one", "path": job.fmu}],
    "connections": connections,
    "cosim_method": "jacobi",
    "iterative": False,
}
coordinator, rows = Coordinator(), []
coordinator.start(config)
for _ in range(job.steps):
    coordinator.do_step(job.step)
    rows.append([coordinator.get_variable(("one", name))[0] for name in job.outputs])
finish(rows, first=1)
