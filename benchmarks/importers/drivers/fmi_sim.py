"""fmi-sim (Rust): inputs from a CSV file, with two rows at each jump; model exchange by Euler steps, the only ones that it has.

A jump stands half a step early: at its instant a step takes the value before it.  Euler steps are as long as the interval of
output, whatever --step says.
"""

import csv
import subprocess
from pathlib import Path

from job import finish, job

#: Euler steps in a communication step.
EULER = 200

job = job()
names, h = list(job.inputs(0)), job.step / (EULER if job.kind == "me" else 1)
rows = [[0.0, *job.inputs(0).values()]]
for k in range(1, job.steps):
    if job.inputs(k - 1) != job.inputs(k):
        at = k * job.step - 0.5 * h
        rows += [[at, *job.inputs(k - 1).values()], [at, *job.inputs(k).values()]]
rows.append([job.steps * job.step, *job.inputs(job.steps - 1).values()])
given, taken = Path(job.folder) / "given.csv", Path(job.folder) / "taken.csv"
with given.open("w", newline="", encoding="utf-8") as file:
    csv.writer(file).writerows([["time", *names], *rows])
command = [job.program, "--model", job.fmu, "--input-file", str(given), "--output-file", str(taken)]
command.append("model-exchange" if job.kind == "me" else "co-simulation")
command += ["-s", "0", "-f", str(job.steps * job.step), "--output-interval", str(h), "--step", str(h)]
done = subprocess.run(command, cwd=job.folder, capture_output=True, text=True)
if not taken.is_file():
    said = [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("Error")]
    raise SystemExit(said[-1] if said else (done.stdout + done.stderr)[-1000:])
with taken.open(newline="", encoding="utf-8") as file:
    found = {round(float(row["time"]) / h): row for row in csv.DictReader(file)}  # at a jump the later row
every = round(job.step / h)
finish([[float(found[k * every][name]) for name in job.outputs] for k in range(job.steps + 1)])
