"""How far a long call has come, and the bar that shows it: the one place that draws one.

What may take long takes a `Told`, which it calls now and then with the part that is done, from 0 to 1; a command hands a `Bar`
down as that.  The bar stands on standard error, with the remaining time, as soon as a call has taken DELAY, and goes when it
is over; where standard error is no terminal there is none, not a byte.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self, TypeVar

from .interrupts import held_back

#: Takes the part that is done, from 0 to 1.
Told = Callable[[float], object]
Item = TypeVar("Item")

#: After which a bar appears, and between two looks at the clock, s.
DELAY, PAUSE = 0.5, 0.1


def nobody(part: float) -> None:
    """A `Told` for whoever does not ask."""


class Shares:
    """Several calls that are parts of a whole, one after the other or side by side."""

    def __init__(self, told: Told):
        self._told = told
        self._weights: list[float] = []
        self._parts: list[float] = []

    def share(self, weight: float) -> Told:
        """For a call that takes about so much time beside the others; all shares are given out before the first is used."""
        place = len(self._weights)
        self._weights.append(weight)
        self._parts.append(0.0)

        def told(part: float) -> None:
            self._parts[place] = part
            done = sum(weight * part for weight, part in zip(self._weights, self._parts, strict=True))
            if done:
                self._told(done / sum(self._weights))

        return told


def each(items: Sequence[Item], told: Told) -> Iterator[tuple[Item, Told]]:
    """The items, which take equally long, and for each what its call is to tell."""
    for i, item in enumerate(items):
        yield item, lambda part, i=i: told((i + part) / len(items))  # type: ignore[misc]
        told((i + 1) / len(items))


@contextmanager
def expected(seconds: float, told: Told | None) -> Iterator[None]:
    """For what cannot tell how far it has come, but takes about so long: told by the clock, and all of it at the end."""
    if told is None:
        yield
        return
    begin, over = time.monotonic(), threading.Event()

    def tell() -> None:
        while not over.wait(PAUSE):
            told(guessed((time.monotonic() - begin) / seconds))

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    try:
        yield
        told(1.0)
    finally:
        over.set()
        thread.join()


def guessed(time: float) -> float:
    """Part that is done of what was expected to take 1: the time itself, and slower towards 1 where it takes longer."""
    return time if time < 0.8 else 1.0 - 0.2 * math.exp(4.0 - 5.0 * time)


def at_terminal() -> bool:
    """Whether standard error is a terminal that can draw over a line."""
    try:
        return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    except (AttributeError, ValueError):  # None, or closed
        return False


class Bar:
    """A context in which `bar(part)` shows how far something has come, and `bar.what` what it is.

    Remaining times go by the mean rate so far.
    """

    def __init__(self, what: str):
        self.begin(what)
        self._drawn: Any = None  # rich's Progress, while it is shown
        self._lock = threading.RLock()
        self._timer = threading.Timer(DELAY, self._show) if at_terminal() else None

    def __enter__(self) -> Self:
        if self._timer:
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *error) -> None:
        self.end()

    def end(self) -> None:
        """It does not come back."""
        if self._timer:
            with held_back():
                self._timer.cancel()
                self._timer.join()
                self._hide()

    def __call__(self, part: float) -> None:
        if self._timer:
            self._seen = part, time.monotonic()

    def begin(self, what: str) -> Self:
        """Something else, of which nothing is done yet."""
        self.what, self._begin = what, time.monotonic()
        self._seen = 0.0, self._begin  # part that is done, and since when that is known
        return self

    @contextmanager
    def aside(self) -> Iterator[None]:
        """In this block lines can be printed: the bar is out of their way."""
        with self._lock:
            shown = self._drawn is not None
            self._hide()
            try:
                yield
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                if shown:
                    self._show()

    def print(self, text: str) -> None:
        """On standard output."""
        with self.aside():
            print(text, flush=True)

    @property
    def part(self) -> float:
        """That is done, from 0 to 1."""
        return min(self._seen[0], 1.0)

    @property
    def left(self) -> float | None:
        """Remaining time, s; None: not known yet."""
        part, at = self._seen
        if part <= 0.0:
            return None
        return max((at - self._begin) * (1.0 / part - 1.0) - (time.monotonic() - at), 0.0)

    def _show(self) -> None:
        with self._lock, held_back():
            self._drawn = _drawn(self)
            self._drawn.start()

    def _hide(self) -> None:
        with self._lock, held_back():
            if self._drawn is not None:
                self._drawn.stop()
            self._drawn = None


def _drawn(bar: Bar) -> Any:
    """rich's Progress of a bar; it asks the bar whenever it is drawn anew."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
    from rich.text import Text

    class Left(ProgressColumn):
        def render(self, task):
            return Text("" if bar.left is None else f"{clock(bar.left)} left")

    class Drawn(Progress):
        def get_renderables(self):
            for task in self.task_ids:
                self.update(task, completed=bar.part, description=bar.what)
            yield from super().get_renderables()

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:3.0f} %"), Left()
    console = Console(stderr=True)
    drawn = Drawn(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
    drawn.add_task(bar.what, total=1.0)
    return drawn


def clock(seconds: float) -> str:
    """As in 0:07 or 1:02:03."""
    minutes, s = divmod(round(seconds), 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02d}:{s:02d}" if hours else f"{m}:{s:02d}"
