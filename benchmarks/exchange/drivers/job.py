"""What every driver shares: it reads a job, takes each of its settings in turn, and writes what its tool computed.

A driver is called as `python driver.py job.json result.json`.  The job: fmu, a path; settings: tolerances, or steps, s; forces:
input -> N, held from the start; duration, s; instants: of output after the start, equally spaced; outputs: names; references:
variable -> value reference; program: a tool's own file, where it has one; folder: with the extracted FMU in fmu.  The result:
per setting processor seconds, rows of outputs at the instants, and why it failed, where it did.
Standard library only: a tool's environment has nothing else for certain.
"""

import json
import sys
import time


class Job:
    def __init__(self, path):
        with open(path, encoding="utf-8") as file:
            self.__dict__.update(json.load(file))

    @property
    def interval(self):
        return self.duration / self.instants

    def times(self):
        """After the start."""
        return [self.duration * (k + 1) / self.instants for k in range(self.instants)]


JOB = Job(sys.argv[1])


def carry_out(prepared):
    """prepared(setting): a function without arguments that integrates anew and returns rows of outputs; what it needs to be
    given before is not timed.  It may return (rows, seconds) where it knows its time better."""
    found = []
    for setting in JOB.settings:
        one = {"seconds": None, "rows": None, "failure": None}
        found.append(one)
        try:
            run = prepared(setting)
            begin = time.process_time()
            rows = run()
            seconds = time.process_time() - begin
            if isinstance(rows, tuple):
                rows, seconds = rows
            one["rows"], one["seconds"] = [[float(x) for x in row] for row in rows], seconds
        except Exception as error:  # whatever a tool says is told
            one["failure"] = f"{type(error).__name__}: {str(error).splitlines()[-1]}"[:300]
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(found, file)
