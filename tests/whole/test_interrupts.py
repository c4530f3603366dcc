"""Programs that are killed, interrupted or asked to end: nothing of theirs goes on, and what they left is removed."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tensegrity_core import cli, files, interrupts
from tensegrity_core.files import scratch, write_text
from tests.support.killed import COMMANDS, PATIENCE, Command, members, start, until
from tests.whole.test_files import sources

ROOT = Path(__file__).resolve().parents[2]
if not Path("/proc/self/stat").exists():
    pytest.skip("looks for processes in /proc", allow_module_level=True)

#: Two workers, one busy and one that waits, and a run from outside; scratch.py also writes half a file.
PROGRAM = """
import sys, threading, time
from pathlib import Path
from tensegrity_core import processes
from tensegrity_core.files import replacing, scratch
from tensegrity_core.interrupts import program

def busy(folder, name):
    (Path(folder) / name).touch()
    while name == "busy":
        pass
    time.sleep(1e6)

def main():
    folder = sys.argv[1]
    outside = [sys.executable, "-c", OUTSIDE, folder]
    with processes.Workers(2) as workers, replacing(Path(folder) / "result.csv") as file, scratch(folder):
        file.write(b"half")
        for name in ("busy", "asleep"):
            workers.submit(busy, folder, name)
        threading.Thread(target=processes.run, args=(outside,), daemon=True).start()
        workers.submit(busy, folder, "never").result()

OUTSIDE = '''
import sys, time
from pathlib import Path
from fmu_src.validation.outside import end_with_parent
end_with_parent()
(Path(sys.argv[1]) / "outside").touch()
while True:
    pass
'''

if __name__ == "__main__":
    program(main)
"""


@pytest.fixture(autouse=True)
def no_signal_is_ignored():
    """A shell's background jobs ignore SIGINT, and what they start inherits that."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def program(tmp_path):
    """The program above at work, and its folder."""
    (tmp_path / "program.py").write_text(PROGRAM, encoding="utf-8")
    folder = tmp_path / "ü #1"
    folder.mkdir()
    process = start([sys.executable, tmp_path / "program.py", folder])
    until(lambda: {"busy", "asleep", "outside"} <= {path.name for path in folder.iterdir()} or process.poll() is not None)
    assert len(members(process.pid)) >= 4, process.stderr.read()
    yield process, folder
    for left in members(process.pid):
        os.kill(left, signal.SIGKILL)


def test_a_killed_program_takes_all_its_processes_along(program):
    process, folder = program
    process.kill()
    process.wait()
    until(lambda: not members(process.pid))
    assert len([path for path in folder.iterdir() if path.suffix == ".tmp"]) == 2
    write_text(folder / "result.csv", "whole")
    assert sorted(path.name for path in folder.iterdir()) == ["asleep", "busy", "outside", "result.csv"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
@pytest.mark.parametrize("to", ["all", "one"])
def test_a_program_that_is_asked_to_end_says_so_in_one_line(number, to, program):
    """Ctrl-C and a closed terminal reach all its processes, `kill` only the first; either way nothing stays."""
    process, folder = program
    if to == "all" and number != signal.SIGTERM:
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 128 + number
    assert (out, err) == ("", "interrupted\n" if number == signal.SIGINT else f"ended by {number.name}\n")
    until(lambda: not members(process.pid))
    assert sorted(path.name for path in folder.iterdir()) == ["asleep", "busy", "outside"]


def test_a_worker_that_dies_is_an_error_and_no_wait(tmp_path):
    code = """
import os, signal
from concurrent.futures.process import BrokenProcessPool
from tensegrity_core.processes import Workers
def die():
    os.kill(os.getpid(), signal.SIGKILL)
if __name__ == "__main__":
    try:
        with Workers(2) as workers:
            workers.submit(die).result()
    except BrokenProcessPool:
        print("broken")
"""
    (tmp_path / "dying.py").write_text(code, encoding="utf-8")
    out, err = start([sys.executable, tmp_path / "dying.py"]).communicate(timeout=PATIENCE)
    assert out == "broken\n", err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=lambda number: number.name)
def test_a_validation_is_interrupted(number, tmp_path):
    """While the FMU runs from outside, or its references do: whichever is first."""
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, ROOT / "build_fmu.py", "six_bar", "--runtime", "native", "--no-cache"]
    with start(command, cwd=tmp_path, TMPDIR=str(tmp_path / "temporary")) as process:
        assert process.stdout.readline().startswith("wrote ")
        until(lambda: len(members(process.pid)) > 1)
        os.killpg(process.pid, number) if number == signal.SIGINT else process.kill()
        err = process.stderr.read()
        assert process.wait() == (130 if number == signal.SIGINT else -number)
        until(lambda: not members(process.pid))
    if number == signal.SIGINT:
        assert err == "interrupted\n" and not list((tmp_path / "temporary").iterdir())
    assert [path.name for path in (tmp_path / "dist" / "native").iterdir()] == ["six_bar.fmu"]


@pytest.mark.parametrize("name", ["tower", "simulate .csv", "view"])
def test_a_command_that_is_ended_leaves_whole_files(name, made_page, tmp_path):
    """At two moments; `python -m tests.support.killed` tries all commands at many."""
    command = Command(COMMANDS[name], tmp_path, tmp_path)
    found = [command.end(part * command.seconds, number) for part, number in ((0.6, signal.SIGKILL), (0.8, signal.SIGINT))]
    assert set(found) <= {"killed", "killed, with leftovers", "interrupted", "before it began", "was done"}


def test_what_is_there_in_part_is_found(made_page, tmp_path):
    """Else the test above, and that command, would find nothing."""
    command = Command(COMMANDS["tower"], tmp_path, tmp_path)
    (file,) = command.files()
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(AssertionError, match="not as it was written"):
        command.require_whole()


def test_ctrl_c_while_a_program_starts(tmp_path):
    """Loading what the command needs is a part of the program."""
    program = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)\n"
    (tmp_path / "numpy.py").write_text(program, encoding="utf-8")
    for command in (["-m", "tensegrity_core", "check", "two_bar"], [str(ROOT / "build_fmu.py"), "two_bar"]):
        surroundings = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True, env=surroundings, cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_handlers_are_as_before_and_others_are_left_alone(monkeypatch, capsys):
    before = [signal.getsignal(number) for number in interrupts.ASKING]
    seen = []
    assert interrupts.interruptible(lambda: seen.append(signal.getsignal(signal.SIGTERM)) or 7) == 7
    assert isinstance(seen[0], interrupts.Requests) and [signal.getsignal(number) for number in interrupts.ASKING] == before
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        interrupts.interruptible(lambda: seen.append(signal.getsignal(signal.SIGTERM)) or 0)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    assert seen[1] == signal.SIG_IGN


def test_a_request_that_somebody_swallows_is_repeated():
    """As libraries do that catch everything around an import; here three times."""
    swallowed = []

    def run():
        while True:
            try:
                if not swallowed:
                    os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(10.0)
                return 0
            except:  # noqa: E722 (what such a library catches)
                swallowed.append(sys.exc_info()[0])
                if len(swallowed) == 3:
                    raise

    assert interrupts.interruptible(run) == 128 + signal.SIGTERM
    assert swallowed == 3 * [interrupts.Ended]


@pytest.mark.parametrize("thread", [False, True], ids=["main", "another"])
def test_requests_wait_for_the_end_of_what_is_done_whole(thread, tmp_path):
    """Whichever thread the system gives the signal to; and the folder is removed although the request comes meanwhile."""
    done = []

    def run():
        with scratch(tmp_path) as folder, interrupts.held_back():
            with interrupts.held_back():
                (folder / "file").touch()
                if thread:
                    other = threading.Thread(target=lambda: signal.pthread_kill(threading.get_ident(), signal.SIGTERM))
                    freed = signal.pthread_sigmask(signal.SIG_UNBLOCK, interrupts.ASKING)  # which the new thread inherits
                    other.start()
                    other.join()
                    signal.pthread_sigmask(signal.SIG_SETMASK, freed)
                else:
                    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)
                done.append("inner")
            done.append("outer")
        done.append("never")

    assert interrupts.interruptible(run) == 128 + signal.SIGTERM
    assert done == ["inner", "outer"] and not list(tmp_path.iterdir())


def test_a_request_that_comes_while_an_object_is_removed_is_repeated(capsys):
    """Python prints what is raised there, and goes on."""

    class Removed:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.0)

    def run():
        one = Removed()
        del one
        time.sleep(10.0)
        return 0

    assert interrupts.interruptible(run) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_an_interrupted_program_is_not_taken_down_piece_by_piece(tmp_path):
    """What libraries ask for at the end is done, what is buffered is written; objects are not removed any more."""
    code = """
import atexit, os, signal, sys
from tensegrity_core.interrupts import program
class Left:
    def __del__(self):
        os.write(2, b"removed")
def main():
    atexit.register(lambda: print("at the end"))
    print("begun")
    main.left = Left()
    os.kill(os.getpid(), signal.SIGTERM)
program(main)
"""
    process = start([sys.executable, "-c", code], PYTHONUNBUFFERED="")
    assert process.communicate(timeout=PATIENCE) == ("begun\nat the end\n", "ended by SIGTERM\n")
    assert process.returncode == 143


def test_an_interrupted_command_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(files, "write_text", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    words = ["tower", "1", "--output", str(tmp_path / "tower.toml")]
    assert interrupts.interruptible(lambda: cli.main(words)) == 130
    assert not list(tmp_path.iterdir()) and capsys.readouterr().err == "interrupted\n"


def test_processes_are_started_in_one_place():
    """No module but processes.py makes workers."""
    ours = ROOT / "tensegrity_core" / "processes.py"
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
            found = {"multiprocessing", "concurrent.futures.ProcessPoolExecutor", "joblib"} & set(names)
            assert path == ours or not found, f"{path} imports {found}"
