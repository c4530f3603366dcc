"""The project's exceptions.  Each message names the offending thing, its value and the remedy, in one line of bounded
length."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 1500  # letters of a message
LONGEST_PART = 500  # of the problem or the remedy of a SceneError
LONGEST_FILE = 300
LONGEST_VALUE = 120
MOST_NAMES = 30  # that a message lists


class TensegrityError(Exception):
    """Base class of every error that a user of this package can cause.  It can be passed between processes."""

    def __init__(self, message: str):
        super().__init__(shown(message))

    def __reduce__(self):
        return _again, (type(self), self.args, self.__dict__)


class SceneError(TensegrityError):
    """A scene file that cannot become a model.

    file: the file's path; key: dotted path of the key, such as ``strings.s1.nodes``; value: what stands there.
    """

    def __init__(self, file: str, key: str, value: object, problem: str, remedy: str):
        self.file, self.key, self.value, self.problem, self.remedy = file, key, value, problem, remedy
        place = f"{_cut(file, LONGEST_FILE)}: {_short(key)} = {_short(_written(value))}"
        super().__init__(f"{place}: {_cut(problem, LONGEST_PART)}. {_cut(remedy, LONGEST_PART)}")


class InputError(TensegrityError):
    """An input, parameter or start value outside its range.  The object that refused it is unchanged.

    index: of the value among all inputs and parameters, where it was the kernel that refused it; reason: the message without
    the value's name and the value.
    """

    index: int
    reason: str


class SimulationError(TensegrityError):
    """A simulation that cannot go on.  status: short name of the cause; time: last good time, s."""

    def __init__(self, status: str, message: str, time: float):
        self.status, self.time = status, time
        super().__init__(f"{status} at t = {time!r} s: {message}")


def shown(text: str) -> str:
    """A text as a message: one line that can be printed, with control characters and the like as their escapes, and not too
    long."""
    letters = (letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in _cut(text, LONGEST))
    return _cut("".join(letters), LONGEST)


def _cut(text: str, longest: int) -> str:
    """The text without its middle where it is too long: what a message is about stands first, what to do last."""
    if len(text) <= longest:
        return text
    tail = (longest - 5) // 2
    return f"{text[: longest - 5 - tail]} ... {text[-tail:]}"


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


def _again(kind: type, args: tuple, state: dict) -> TensegrityError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


def _written(value: object) -> str:
    try:
        return repr(value)
    except (ValueError, RecursionError):  # an integer of too many digits, data that is too deep
        return f"a value of type {type(value).__name__}"


def nearest(name: str, known: Iterable[str], what: str) -> str:
    """The remedy for a name that is none of the known ones: those that are close, or the first of what there are."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=3)
    return f"did you mean {' or '.join(close)}?" if close else f"{what} are {', '.join(known[:MOST_NAMES])}"
