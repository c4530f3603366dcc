"""What the FMU's library (fmi2.c) calls beside the slave's methods: to make a slave, and to put Python's answers into the form
that C takes.
"""

from __future__ import annotations

import traceback
from array import array
from pathlib import Path

from ..pythonfmu.enums import Fmi2Status
from .slave import Refused, TensegritySlave


def instantiate(resources: str, name: str, guid: str, visible: bool, logging: bool) -> TensegritySlave:
    """A slave, or an exception whose words the host gets."""
    slave = TensegritySlave(instance_name=name, resources=resources, visible=visible)
    slave.check_guid(guid)
    slave.set_debug_logging(logging, [])
    return slave


def explain(slave: TensegritySlave, error: BaseException) -> int:
    """Log why a call failed; its status.  What nobody foresaw is a fault of the FMU."""
    if isinstance(error, Refused):
        status, text = error.status, str(error)
    else:
        status, text = Fmi2Status.error, f"fault in {place(error)}: {type(error).__name__}: {error}"
        slave.fail()
    slave.log(text, status, f"logStatus{status.name.capitalize()}")
    return int(status)


def place(error: BaseException) -> str:
    """Where an exception arose."""
    frames = traceback.extract_tb(error.__traceback__)
    return f"{frames[-1].name} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else "the FMU"


def drain(queue: list) -> list:
    """Empty a queue of messages into status, category, text, status, category, text, ..., the texts as UTF-8."""
    found = []
    for message in queue:
        found += [int(message.status), encoded(message.category), encoded(message.msg)]
    queue.clear()
    return found


def encoded(text: str) -> bytes:
    return str(text).encode("utf-8", "replace").replace(b"\0", b"?")


def packed(code: str | None, values, count: int):
    """Values that are not yet an array of C's type ('d', 'i'), or texts (None), as such; raises where they are not so many."""
    found = [encoded(value) for value in values] if code is None else array(code, values)
    if len(found) != count:
        raise ValueError(f"{len(found)} values were returned where {count} were asked for")
    return found
