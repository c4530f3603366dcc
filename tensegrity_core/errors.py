"""The project's exceptions.  Each message names the offending thing, its value and the remedy."""

from __future__ import annotations


class TensegrityError(Exception):
    """Base class of every error that a user of this package can cause."""


class SceneError(TensegrityError):
    """A scene file that cannot become a model.

    file: the file's path; key: dotted path of the key, such as ``strings.s1.nodes``; value: what stands there.
    """

    def __init__(self, file: str, key: str, value: object, problem: str, remedy: str):
        self.file, self.key, self.value, self.problem, self.remedy = file, key, value, problem, remedy
        super().__init__(one_line(f"{file}: {_short(key)} = {_short(_written(value))}: {problem}. {remedy}"))


class InputError(TensegrityError):
    """An input, parameter or start value outside its range.  The object that refused it is unchanged."""


class SimulationError(TensegrityError):
    """A simulation that cannot go on.  status: short name of the cause; time: last good time, s."""

    def __init__(self, status: str, message: str, time: float):
        self.status, self.time = status, time
        super().__init__(f"{status} at t = {time!r} s: {message}")


def one_line(text: str) -> str:
    """A text as one line that can be printed: control characters and the like as their escapes."""
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text)


def _short(text: str) -> str:
    return text if len(text) <= 120 else text[:117] + "..."


def _written(value: object) -> str:
    try:
        return repr(value)
    except (ValueError, RecursionError):  # an integer of too many digits, data that is too deep
        return f"a value of type {type(value).__name__}"
