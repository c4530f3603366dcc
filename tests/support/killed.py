"""Commands that are killed, or interrupted, at any moment: ``python -m tests.support.killed [--count N] [--seed S]``

Each command is run once to its end, which gives its duration and its files; then N times it is ended at a random moment before
that, in turn by SIGKILL (only the first process) and by Ctrl-C (all of them, as a terminal does).  What must hold every time:

- a file of the command's is there as a whole, or as it was before, or not at all;
- no process of it goes on;
- Ctrl-C is answered by one line and leaves nothing that is temporary;
- after SIGKILL the same command runs to its end, and then nothing that is temporary is left either.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 120.0  # s, until a wait is given up; never reached where all is well
LEFT = ".tensegrity-*.tmp"

#: Words of each command; {fmu} is an FMU that is there before.
COMMANDS = {
    "new": "new mast",
    "tower": "tower 12 --output tower.toml",
    "simulate .csv": "simulate six_bar_nsh --force n10.z=40 --duration 2 --output run.csv",
    "simulate .nc": "simulate three_bar_nsh --force n4.z=45 --duration 2 --output run.nc",
    "animate": "animate two_bar --force n4.z=5 --duration 0.5 --output film.gif",
    "view": "view three_bar_nsh --output page.html",
    "path": "path two_bar_nsh --force n3.z=1 n4.z=1 --to 30 --output path.csv --figure path.png",
    "modes": "modes three_bar --output modes.csv --figure modes.svg",
    "experiment": "experiment IV --duration 1 --output results",
    "run": "run {fmu} --duration 2 --output fmu.nc",
    "build": "build two_bar --runtime both --no-cache",
}


def members(session: int) -> list[int]:
    """Processes of a session that still run."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, _, its = (entry / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[:4]
            except OSError:  # it has ended meanwhile
                continue
            if int(its) == session and state not in "ZX":
                found.append(int(entry.name))
    return found


def until(condition) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def start(command: list, cwd: Path | None = None, **surroundings) -> subprocess.Popen:
    """A program as the leader of a session of its own, as in a terminal."""
    surroundings = {**os.environ, "PYTHONPATH": str(ROOT), **surroundings}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*map(str, command)], env=surroundings, cwd=cwd, start_new_session=True, **pipes)


class Command:
    """A command in a folder of its own, which holds folder/here, where it writes, and folder/temporary."""

    def __init__(self, words: str, folder: Path, fmu: Path):
        self.words = [word.format(fmu=fmu) for word in words.split()]
        self.here, self.temporary = folder / "ü #1", folder / "temporary"
        self.here.mkdir(parents=True)
        self.temporary.mkdir()
        begin = time.monotonic()
        self.finish()
        self.seconds = time.monotonic() - begin
        self.whole = {path.relative_to(self.here): path.read_bytes() for path in self.files()}
        assert self.whole

    def files(self) -> list[Path]:
        return [path for path in self.here.rglob("*") if path.is_file() and not self._is_temporary(path)]

    def _is_temporary(self, path: Path) -> bool:
        return any(Path(part).match(LEFT) for part in (path, *path.relative_to(self.here).parents))

    def temporaries(self) -> list[Path]:
        return [*self.here.rglob(LEFT), *self.temporary.iterdir()]

    def begin(self) -> subprocess.Popen:
        command = [sys.executable, "-m", "tensegrity_core", *self.words]
        return start(command, cwd=self.here, TMPDIR=str(self.temporary), MPLBACKEND="agg")

    def finish(self) -> None:
        """Run it to its end.  Raises AssertionError."""
        with self.begin() as process:
            _, err = process.communicate(timeout=PATIENCE)
            assert process.returncode == 0, err

    def end(self, moment: float, number: int) -> str:
        """End it after this time, s; returns how it ended.  Raises AssertionError where something is not as it must be."""
        clear(self.here)
        with self.begin() as process:
            time.sleep(moment)
            if number == signal.SIGINT:
                os.killpg(process.pid, number)
            else:
                process.kill()
            _, err = process.communicate(timeout=PATIENCE)
            until(lambda: not members(process.pid))
        self.require_whole()
        if process.returncode == 0:
            return "was done"
        if number == signal.SIGINT:
            # before Python has taken the signal over, the system ends the process, or Python prints where it was: not ours yet
            early = process.returncode == -signal.SIGINT or "site.py" in err or "importlib" in err
            assert early or (process.returncode == 130 and err.splitlines()[-1:] == ["interrupted"]), err
            assert early or len(err.splitlines()) == 1, err
            assert not self.temporaries(), self.temporaries()
            return "before it began" if early else "interrupted"
        left = bool(self.temporaries())
        if "new" in self.words:
            clear(self.here)  # which leaves a file that is there alone, and says so
        self.finish()
        self.require_whole()
        assert not list(self.here.rglob(LEFT)), list(self.here.rglob(LEFT))
        return "killed, with leftovers" if left else "killed"

    def require_whole(self) -> None:
        """Raises AssertionError where a file is there in part."""
        for path in self.files():
            expected, found = self.whole[path.relative_to(self.here)], path.read_bytes()
            if found == expected:
                continue
            if path.suffix == ".fmu":  # with the time at which it was made
                assert zipfile.ZipFile(path).testzip() is None, path
            elif path.suffix in (".html", ".svg"):
                assert found.rstrip().endswith((b"</html>", b"</svg>")), path
            else:
                raise AssertionError(f"{path} is not as it was written without a disturbance")


def clear(folder: Path) -> None:
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def built(folder: Path) -> Path:
    """An FMU for the command `run`."""
    command = [sys.executable, "-m", "tensegrity_core", "build", "two_bar", "--runtime", "native", "--no-validate"]
    subprocess.run([*command, "--output", folder], check=True, capture_output=True, cwd=ROOT)
    return folder / "native" / "two_bar.fmu"


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.support.killed", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10, metavar="N", help="moments for each command (default: 10)")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS), help="default: all")
    options = parser.parse_args(words)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell's background jobs have it, and all that they start
        signal.signal(signal.SIGINT, signal.default_int_handler)
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:
        fmu = built(Path(name) / "fmu")
        for number, command in enumerate(options.commands):
            one = Command(COMMANDS[command], Path(name) / str(number), fmu)
            ends: Counter[str] = Counter()
            for i in range(options.count):
                ends[one.end(chance.random() * one.seconds, (signal.SIGKILL, signal.SIGINT)[i % 2])] += 1
            print(
                f"{command}: {one.seconds:.1f} s; {', '.join(f'{end} {count}' for end, count in sorted(ends.items()))}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
