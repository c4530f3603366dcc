"""A container by the FMU Manipulation Toolbox, of the standard of the FMU in it, stepped by fmpy."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

from calls import rows
from job import finish, job

job = job()
folder = Path(job.folder)
shutil.copy(job.fmu, folder / "inner.fmu")
own = job.whole(job.inputs(0))
described = {
    "name": "outer.fmu",
    "fmu": ["inner.fmu"],
    "input": [[name, "inner.fmu", name] for name in own],
    "output": [["inner.fmu", name, name] for name in job.whole_outputs()],
    "auto_link": False,
    "auto_input": False,
    "auto_output": False,
    "step_size": job.step,
}
(folder / "outer.json").write_text(json.dumps(described), encoding="utf-8")
command = [str(Path(sys.executable).parent / "fmucontainer"), "-container", "outer.json", "-fmu-directory", str(folder)]
done = subprocess.run([*command, "-fmi", job.standard[0]], cwd=folder, capture_output=True, text=True)
outer = folder / "outer.fmu"
if not outer.is_file():
    raise SystemExit((done.stdout + done.stderr)[-1500:])
finish(rows(str(outer), job))
