"""What shows how far a long call has come: on a terminal a bar with the remaining time, elsewhere not a byte."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tensegrity_core import progress
from tensegrity_core.cli import main
from tensegrity_core.files import write_text
from tensegrity_core.output.page import bundle
from tensegrity_core.progress import Bar, Shares, at_terminal, clock, each, expected, guessed
from tensegrity_core.scene.towers import tower_text

if sys.platform != "win32":
    import pty

ROOT = Path(__file__).resolve().parents[2]
HIDE, SHOW = b"\x1b[?25l", b"\x1b[?25h"
#: What rich leaves of the line that the bar was in.
EMPTIED = b"\r\x1b[1A\x1b[2K"
LEFT = re.compile(rb"[0-9]+ % \d+:\d\d left")
#: The command with a bar that appears at once, so that runs can be short.
COMMAND = """
from tensegrity_core import progress
from tensegrity_core.cli import main
from tensegrity_core.interrupts import program
progress.DELAY = 0.0
program(main)
"""


def until(condition) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class Terminal:
    """A command of `tensegrity` whose standard error is a terminal; its standard output is one, too, or a pipe."""

    def __init__(self, words, folder, piped=True, term="xterm"):
        self.ours, theirs = pty.openpty()
        environment = os.environ | {"TERM": term, "COLUMNS": "100", "PYTHONPATH": str(ROOT)}
        out = subprocess.PIPE if piped else theirs
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell's background jobs have it, and all that they start
            signal.signal(signal.SIGINT, signal.default_int_handler)
        command = [sys.executable, "-c", COMMAND, *words]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=theirs, cwd=folder, env=environment, start_new_session=True
        )
        os.close(theirs)
        self.seen = b""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                more = os.read(self.ours, 65536)
            except OSError:  # Linux: everybody has closed the other end
                more = b""
            if not more:
                return
            self.seen += more

    def until(self, what: re.Pattern) -> None:
        until(lambda: what.search(self.seen) or self.process.poll() is not None)

    def end(self) -> bytes:
        """Wait for it; returns what went to a pipe."""
        out = self.process.communicate()[0]
        self._reader.join()
        os.close(self.ours)
        return out or b""


@pytest.fixture
def terminal(tmp_path):
    if sys.platform == "win32":
        pytest.skip("pseudo-terminals of POSIX")
    return lambda words, **options: Terminal(words.split(), tmp_path, **options)


RUN = "simulate six_bar_nsh --duration 40 --step 0.001"


def test_a_bar_with_the_remaining_time_is_shown_and_goes(terminal):
    one = terminal(RUN)
    out = one.end()
    assert one.process.returncode == 0
    assert LEFT.search(one.seen) and b"six_bar_nsh" in one.seen
    assert one.seen.count(HIDE) == one.seen.count(SHOW) == 1
    assert one.seen.endswith(SHOW + EMPTIED)
    assert b"\x1b" not in out and out.startswith(b"six_bar_nsh: ")


def test_json_is_whole_beside_a_bar(terminal):
    one = terminal(f"{RUN} --json")
    assert json.loads(one.end())["scene"] == "six_bar_nsh"
    assert LEFT.search(one.seen)


def test_what_is_printed_meanwhile_stands_in_lines_of_its_own(terminal):
    one = terminal("build two_bar three_bar --no-validate --no-page", piped=False)
    one.end()
    assert one.process.returncode == 0 and b"packing" in one.seen
    assert one.seen.count(HIDE) == one.seen.count(SHOW)
    assert one.seen.endswith(SHOW + EMPTIED)
    lines = [line.rpartition(EMPTIED)[2] for line in one.seen.split(b"\r\n")]
    assert sum(line.startswith(b"wrote dist/") and line.endswith(b".fmu") for line in lines) == 4


@pytest.mark.parametrize("number", [2, 15])
def test_a_terminal_is_whole_again_after_an_interrupt(number, terminal, tmp_path):
    one = terminal("animate two_bar --duration 100 --output film.gif")
    one.until(LEFT)
    one.process.send_signal(number)
    assert one.end() == b""
    assert one.process.returncode == 128 + number
    told = "interrupted" if number == signal.SIGINT else "ended by SIGTERM"
    assert one.seen.count(HIDE) == one.seen.count(SHOW)
    assert one.seen.endswith(SHOW + EMPTIED + f"{told}\r\n".encode())
    assert not list(tmp_path.iterdir())


def test_a_pipe_gets_no_byte_of_it(tmp_path):
    done = subprocess.run([sys.executable, "-c", COMMAND, *RUN.split()], capture_output=True, cwd=tmp_path)
    assert done.stderr == b"" and done.stdout.startswith(b"six_bar_nsh: ") and b"\x1b" not in done.stdout


def test_a_terminal_that_cannot_draw_over_a_line_gets_none(terminal):
    one = terminal(RUN, term="dumb")
    assert one.end().startswith(b"six_bar_nsh: ") and one.seen == b""


def test_a_closed_stream_is_no_terminal(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    assert not at_terminal()
    with Bar("nothing") as bar:
        bar(0.5)


#: What may take long, in short.
LONG = {
    "check": "check tower.toml",
    "simulate": "simulate two_bar --duration 1 --output run.csv",
    "animate": "animate two_bar --duration 0.2 --output film.gif",
    "view": "view two_bar --no-live --duration 1 --output page.html",
    "run": "run {fmu} --duration 1",
    "path": "path three_bar_nsh --force n4.z=1 --to 30 --back --unstable",
    "modes": "modes three_bar_nsh --force n4.z=10",
    "experiment": "experiment III --systems two_bar --duration 3",
    "tower": "tower 30 --output tower.toml",
}


@pytest.mark.parametrize("words", LONG.values(), ids=LONG)
def test_whatever_may_take_long_tells_how_far_it_is(words, native_fmus, tmp_path, monkeypatch, capsys, request):
    """Parts that grow from 0 to 1, again and again where there are stages; two of them at least, so that time can be told."""
    if words.startswith("view"):
        if bundle.missing():
            pytest.skip("the page cannot be built here")
        request.getfixturevalue("made_page")
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "tower.toml", tower_text(30))
    told = []
    monkeypatch.setattr(Bar, "__call__", lambda self, part: told.append((self.what, part)))
    assert main(words.format(fmu=native_fmus["two_bar"]).split()) == 0
    assert all(0.0 <= part <= 1.0 + 1e-12 for _, part in told)
    assert {what for what, part in told if part > 0.999}, told
    for (what, before), (same, after) in itertools.pairwise(told):
        assert after >= before - 1e-12 or what != same, (what, before, after)


def test_shares_and_items_make_up_the_whole():
    told = []
    shares = Shares(told.append)
    first, none, last = shares.share(1.0), shares.share(0.0), shares.share(3.0)
    for _, one in each("ab", first):
        one(0.5)
    none(1.0)
    last(0.5)
    last(1.0)
    assert told == [0.0625, 0.125, 0.1875, 0.25, 0.25, 0.625, 1.0]


def test_what_cannot_be_asked_goes_by_the_clock(monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 0.001)
    told = []
    with expected(1e-9, told.append):
        until(lambda: len(told) > 1)
    assert told == sorted(told) and told[-1] == 1.0 and 0.8 < told[0] <= 1.0
    told.clear()
    with pytest.raises(ValueError, match="stop"), expected(1e9, told.append):
        raise ValueError("stop")
    assert 1.0 not in told
    parts = [guessed(t / 10.0) for t in range(60)]
    assert parts == sorted(parts) and parts[8] == pytest.approx(0.8) and parts[-1] < 1.0


@pytest.mark.parametrize("seconds, shown", [(0.4, "0:00"), (7.0, "0:07"), (59.6, "1:00"), (3723.0, "1:02:03")])
def test_clock(seconds, shown):
    assert clock(seconds) == shown
