"""Programs that end quietly when they are told to: Ctrl-C, SIGTERM, a terminal that is closed."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: What asks a program to end; each system knows some of them.
ASKING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
#: Of these, what a terminal sends to all of its programs.
TERMINAL = tuple(number for number in ASKING if number != signal.SIGTERM)
#: What Python does with them by itself; whoever has asked for something else gets that.
_USUAL = (signal.SIG_DFL, signal.default_int_handler)
#: After which a request that somebody has swallowed is repeated, s.
_AGAIN = 0.1


class Ended(KeyboardInterrupt):
    """A signal of ASKING.  It passes where Ctrl-C passes: no `except Exception` takes it for a failure.  number: the signal's."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def interruptible(run: Callable[[], int]) -> int:
    """Call a program's main function; returns its exit code, or 128 + the signal's number where it was asked to end.

    All `with` blocks that the program is in are left, then one line on stderr says so.  For the main thread.
    """
    going_on = threading.Event()
    going_on.set()

    def end(number: int, frame) -> None:
        raise watched(Ended(number))  # no variable here may hold it, or it lives on in its own traceback

    def watched(error: Ended) -> Ended:
        weakref.finalize(error, repeat, error.number).atexit = False
        return error

    def repeat(number: int) -> None:
        """Some libraries catch everything, at times while they are imported: then the exception vanishes, the program goes on."""
        if going_on.is_set():
            timer = threading.Timer(_AGAIN, lambda: going_on.is_set() and _send(number))
            timer.daemon = True
            timer.start()

    before = {}
    if threading.current_thread() is threading.main_thread():
        usual = [number for number in ASKING if signal.getsignal(number) in _USUAL]
        before = {number: signal.signal(number, end) for number in usual}
    try:
        return run()
    except KeyboardInterrupt as asked:
        going_on.clear()
        number = getattr(asked, "number", signal.SIGINT)
        print("interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}", file=sys.stderr)
        return 128 + number
    finally:
        going_on.clear()
        for number, handler in before.items():
            signal.signal(number, handler)


def _send(number: int) -> None:
    """A signal to the main thread; where the system can, it also wakes it."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident, number)
    else:
        _thread.interrupt_main(number)


@contextmanager
def held_back(numbers: tuple[int, ...] = ASKING) -> Iterator[None]:
    """What is done in this block is done whole: signals to this thread wait for its end.  Processes that are started in it never
    get them.  (Windows knows no such thing.)"""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
