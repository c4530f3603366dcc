"""Processes that work for this one.  They end when it ends, however it ends: each holds the reading end of a pipe whose writing
end nobody else has, so that the operating system closes it in any case.  The same on every system.

A worker also ends if it is busy: the pipe is watched by a thread of its own.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import threading
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing.connection import Connection, wait
from pathlib import Path

from .interrupts import TERMINAL, held_back

#: Windows waits for no more processes than this.
MOST = 61
#: Places in which tasks can tell how far they have come.
PLACES = 4096
#: In a worker: those places, once it has been attached.
_told: list = []


class Workers(ProcessPoolExecutor):
    """Fresh processes, one per processor, as a context: where its block is left by an exception (Ctrl-C is one), they end at
    once and what was submitted is dropped; otherwise the block waits for all of it.
    """

    def __init__(self, count: int | None = None):
        context = multiprocessing.get_context("spawn")
        self._pipe, self._lifeline = context.Pipe(duplex=False)
        self.parts = context.RawArray("d", PLACES)  # by place, see `tell`
        self._started: list[multiprocessing.process.BaseProcess] = []
        with held_back(TERMINAL):  # it starts a process that looks after semaphores
            super().__init__(
                min(count or os.cpu_count() or 1, MOST), context, initializer=_attach, initargs=(self._pipe, self.parts)
            )

    def submit(self, *task, **options) -> Future:
        """See concurrent.futures.Executor.submit; starts a process where all are busy."""
        with held_back(TERMINAL):
            before = multiprocessing.active_children()
            try:
                return super().submit(*task, **options)
            finally:
                self._started += [process for process in multiprocessing.active_children() if process not in before]

    def __exit__(self, kind, error, trace) -> None:
        if kind is not None:
            self._lifeline.close()
            for process in self._started:
                process.kill()
        self.shutdown(wait=True, cancel_futures=kind is not None)
        self._lifeline.close()
        self._pipe.close()


def run(command: list[str], folder: Path | None = None, timeout: float | None = None) -> subprocess.CompletedProcess:
    """Run a program that ends when its standard input does, which is when this process ends; returns what it printed, as text;
    bytes that are none are replaced.

    folder: in which it runs; timeout: s, of wall time; then, or by Ctrl-C, it is ended at once.  Raises
    subprocess.TimeoutExpired.
    """
    reading, writing = os.pipe()
    try:
        with held_back(TERMINAL):
            pipe = subprocess.PIPE
            process = subprocess.Popen(
                command, cwd=folder, text=True, errors="replace", stdin=reading, stdout=pipe, stderr=pipe
            )
        with process:
            try:
                out, err = process.communicate(timeout=timeout)
            except BaseException:
                process.kill()
                raise
        return subprocess.CompletedProcess(command, process.returncode, out, err)
    finally:
        os.close(reading)
        os.close(writing)


def tell(place: int, part: float) -> None:
    """In a worker: how far a task has come, from 0 to 1, for whoever looks at `Workers.parts`."""
    for parts in _told:
        parts[place % PLACES] = part


def _attach(pipe: Connection, parts) -> None:
    """In a worker, first of all."""
    _told.append(parts)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it could not be held back
    threading.Thread(target=_end_with, args=(pipe,), daemon=True).start()


def _end_with(pipe: Connection) -> None:
    wait([pipe])
    os._exit(1)
