"""fmusim (Rust): inputs from a CSV file, with two rows at each jump; model exchange by its CVODE."""

import csv
import subprocess
from pathlib import Path

from job import finish, job

job = job()
h = job.step


def row(t, k):
    values = job.whole(job.inputs(k)).values()
    return [t, *(" ".join(map(str, value)) if isinstance(value, list) else value for value in values)]


rows = [row(0.0, 0)]
for k in range(1, job.steps):
    if job.inputs(k - 1) != job.inputs(k):
        rows += [row(k * h, k - 1), row(k * h, k)]
rows.append(row(job.steps * h, job.steps - 1))
given, taken = Path(job.folder) / "given.csv", Path(job.folder) / "taken.csv"
with given.open("w", newline="", encoding="utf-8") as file:
    csv.writer(file).writerows([["time", *job.whole(job.inputs(0))], *rows])
command = [
    job.program,
    "simulate",
    job.fmu,
    "--interface-type",
    job.kind,
    "--tolerance",
    "1e-10",
    "--stop-time",
    str(job.steps * h),
]
command += ["--output-interval", str(h), "--input-file", str(given), "--output-file", str(taken)]
command += [word for name in job.whole_outputs() for word in ("--output-variable", name)]
done = subprocess.run(command, cwd=job.folder, capture_output=True, text=True)
if done.returncode:
    raise SystemExit((done.stdout + done.stderr)[-1000:])
with taken.open(newline="", encoding="utf-8") as file:
    found = {round(float(one["time"]) / h, 6): one for one in csv.DictReader(file)}  # at an event the later row
finish([[float(x) for name in job.whole_outputs() for x in found[float(k)][name].split()] for k in range(job.steps + 1)])
