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
        shown = repr(value)
        if len(shown) > 120:
            shown = shown[:117] + "..."
        super().__init__(f"{file}: {key} = {shown}: {problem}. {remedy}")


class InputError(TensegrityError):
    """An input, parameter or start value outside its range.  The object that refused it is unchanged."""


class SimulationError(TensegrityError):
    """A simulation that cannot go on.  status: short name of the cause; time: last good time, s."""

    def __init__(self, status: str, message: str, time: float):
        self.status, self.time = status, time
        super().__init__(f"{status} at t = {time!r} s: {message}")
