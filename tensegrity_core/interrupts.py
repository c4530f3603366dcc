"""Programs that end quietly when they are told to: Ctrl-C, SIGTERM, a terminal that is closed."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

#: What asks a program to end; each system knows some of them.
ASKING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
#: Of these, what a terminal sends to all of its programs.
TERMINAL = tuple(number for number in ASKING if number != signal.SIGTERM)
#: What Python does with them by itself; whoever has asked for something else gets that.
_USUAL = (signal.SIG_DFL, signal.default_int_handler)
#: After which a request that somebody has swallowed is repeated, s.
_AGAIN = 0.1


class Ended(KeyboardInterrupt):
    """A signal of ASKING.  It passes where Ctrl-C passes: no `except Exception` takes it for a failure.  number: the
    signal's."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def program(run: Callable[[], int]) -> NoReturn:
    """The main function of a program as the whole of it, see `interruptible`; ends the process.

    One that was asked to end does not take the interpreter down piece by piece: that takes a second, and crashes where the
    request has stopped a library half-way through its own loading.
    """
    code = interruptible(run)
    if code < 128:
        sys.exit(code)
    for number in ASKING:
        signal.signal(number, signal.SIG_IGN)
    atexit._run_exitfuncs()  # what libraries have to put back, such as semaphores
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


class Requests:
    """Handler of signals of ASKING while a program is `interruptible`.  held: how many `held_back` blocks it is in; pending:
    what has come meanwhile."""

    def __init__(self):
        self.held, self.pending, self.over = 0, [], False

    def __call__(self, number: int, frame=None) -> None:
        if self.over:
            return
        if self.held:
            self.pending.append(number)
        else:
            raise self._watched(Ended(number))  # no variable here may hold it, or it lives on in its own traceback

    def _watched(self, error: Ended) -> Ended:
        """Some libraries catch everything, at times while they are imported: then the exception vanishes, and is raised
        again."""
        weakref.finalize(error, self._repeat, error.number).atexit = False
        return error

    def _send_again(self, number: int) -> None:
        if not self.over:
            _send(number)

    def _repeat(self, number: int) -> None:
        if not self.over:
            timer = threading.Timer(_AGAIN, self._send_again, (number,))
            timer.daemon = True
            timer.start()

    def release(self) -> None:
        """Leave a `held_back` block; raises what has come meanwhile."""
        self.held -= 1
        if self.pending and not self.held:
            self(self.pending.pop())


def interruptible(run: Callable[[], int]) -> int:
    """Call a program's main function; returns its exit code, or 128 + the signal's number where it was asked to end.

    All `with` blocks that the program is in are left, then one line on stderr says so.  For the main thread.
    """
    requests, shown, before = Requests(), sys.unraisablehook, {}
    sys.unraisablehook = lambda told: None if issubclass(told.exc_type, Ended) else shown(told)  # it is raised again
    if threading.current_thread() is threading.main_thread():
        usual = [number for number in ASKING if signal.getsignal(number) in _USUAL]
        before = {number: signal.signal(number, requests) for number in usual}
    try:
        return run()
    except KeyboardInterrupt as asked:
        requests.over = True
        number = getattr(asked, "number", signal.SIGINT)
        print("interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}", file=sys.stderr)
        return 128 + number
    finally:
        requests.over = True
        sys.unraisablehook = shown
        for number, handler in before.items():
            signal.signal(number, handler)


def _send(number: int) -> None:
    """A signal to the main thread; where the system can, it also wakes it."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:
        _thread.interrupt_main(signal.Signals(number))


@contextmanager
def held_back(numbers: tuple[int, ...] = ASKING) -> Iterator[None]:
    """What is done in this block is done whole: requests to end wait for its end.  Processes that are started in it do not get
    these signals at all.  (Windows knows no such thing.)

    Blocked signals are not enough, because the system gives them to another thread, and Python handles them in the main one.
    """
    handlers = {handler for handler in map(signal.getsignal, ASKING) if isinstance(handler, Requests)}
    if threading.current_thread() is not threading.main_thread():
        handlers = set()
    for handler in handlers:  # one at most
        handler.held += 1
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for handler in handlers:
            handler.release()
