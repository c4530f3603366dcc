"""What every driver shares: it reads a job, and writes what its tool computed.  Standard library only: a tool's environment
has nothing else for certain.

A driver is called as `python driver.py job.json result.json`.  The job: see `scenario.job`.  The result: rows of outputs, one
per communication point from `first` on (0: the start is among them), and a note.
"""

import json
import sys


class Job:
    """fmu, source: paths; coupled: whether the source gives the inputs; step, s; constants: input -> value; wave: name of the
    moving input; values: of it, one per step, N; source_outputs: name -> reference; outputs: names; references: variable ->
    value reference; starts: of all inputs; folder: for scratch; program: a tool's own file, where it has one; standard: '2.0'
    or '3.0'; kind: 'cs' or 'me'; arrays: of FMI 3.0, element -> (array, place, size)."""

    def __init__(self, path):
        with open(path, encoding="utf-8") as file:
            self.__dict__.update(json.load(file))

    @property
    def steps(self):
        return len(self.values)

    def wires(self):
        """(output of the source FMU, input) for each moving or constant input, where a tool couples FMUs, else none; one each,
        as Maestro serves only one input of several that hang on an output."""
        return self.coupled * [("wave", self.wave), *((f"lift{i + 1}", name) for i, name in enumerate(self.constants))]

    def whole(self, values):
        """The same values by the FMU's own variables: arrays whole, their other elements zero (forces rest at that)."""
        found = {}
        for name, value in values.items():
            if name in self.arrays:
                array, place, size = self.arrays[name]
                found.setdefault(array, [0.0] * size)[place] = value
            else:
                found[name] = value
        return found

    def whole_outputs(self):
        """The FMU's own variables that hold the outputs, in their order."""
        return list(dict.fromkeys(self.arrays[name][0] if name in self.arrays else name for name in self.outputs))

    def inputs(self, k):
        """Values by name of the inputs that are not at their starts, held over step k; none where a source gives them."""
        return {} if self.coupled else {**self.constants, self.wave: self.values[k]}


def job():
    return Job(sys.argv[1])


def finish(rows, first=0, note=""):
    """Write the result; rows: lists of outputs in the job's order."""
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump({"rows": [[float(x) for x in row] for row in rows], "first": first, "note": note}, file)
