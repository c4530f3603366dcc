"""fmpy's low-level calls."""

from calls import rows
from job import finish, job

job = job()
finish(rows(job.fmu, job))
