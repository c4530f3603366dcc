"""What the drivers share: `python driver.py job.json result.json`.  The job: see `tools.run`.  The result: a row of outputs per
communication step.  Standard library only: a tool's environment has nothing else for certain.
"""

import json
import sys


def job():
    with open(sys.argv[1], encoding="utf-8") as file:
        return json.load(file)


def finish(rows):
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump([[float(x) for x in row] for row in rows], file)
