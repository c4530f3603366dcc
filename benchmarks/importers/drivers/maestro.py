"""Maestro (INTO-CPS): a source FMU's outputs are the forces (its parameters are no way to set inputs: it leaves them out)."""

import csv
import json
import subprocess
from pathlib import Path

from job import finish, job

job = job()
folder = Path(job.folder)
connections = {f"{{source}}.other.{output}": [f"{{tensegrity}}.one.{name}"] for output, name in job.wires()}
model = {
    "fmus": {"{source}": job.source, "{tensegrity}": job.fmu},
    "connections": connections,
    "parameters": {},
    "logVariables": {"{tensegrity}.one": job.outputs},
    "algorithm": {"type": "fixed-step", "size": job.step},
}
(folder / "model.json").write_text(json.dumps(model), encoding="utf-8")
# half a step more: Maestro counts its time up, and would leave out the last step
experiment = {"startTime": 0.0, "endTime": (job.steps + 0.5) * job.step, "reportProgress": False, "logLevels": {}}
(folder / "experiment.json").write_text(json.dumps({**experiment, "algorithm": model["algorithm"]}), encoding="utf-8")
command = ["java", "-jar", job.program, "import", "sg1", "experiment.json", "model.json", "--interpret", "-output", "results"]
done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
table = folder / "results" / "outputs.csv"
if not table.is_file():
    raise SystemExit((done.stdout + done.stderr)[-1500:])
with table.open(newline="") as file:
    rows = list(csv.DictReader(file))
finish([[row[f"{{tensegrity}}.one.{name}"] for name in job.outputs] for row in rows[: job.steps + 1]])
