"""fmpy's static check of a model description and its binaries."""

from fmpy.validation import validate_fmu
from job import finish, job

problems = validate_fmu(job().fmu)
if problems:
    raise SystemExit("; ".join(problems))
finish([])
