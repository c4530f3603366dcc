"""Checks of the FMU Manipulation Toolbox."""

import subprocess
import sys
from pathlib import Path

from job import finish, job

command = [str(Path(sys.executable).parent / "fmutool"), "-input", job().fmu, "-check"]
done = subprocess.run(command, capture_output=True, text=True)
said = done.stdout + done.stderr
bad = [line for line in said.splitlines() if line.startswith(("ERROR", "WARNING", "CRITICAL"))]
if done.returncode or bad or "compliant" not in said or "No semantic error" not in said:
    raise SystemExit("; ".join(bad) or said[-500:])
finish([])
