"""What an instance knows beyond its kernel, and its form as bytes.

Bytes, little-endian: magic; the FMU's identity (32); CRC-32 of all that follows; mode, flags; start, time, stop (s);
number of refused references and the references; the kernel's state.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field

INSTANTIATED, INITIALIZATION, STEPPING, TERMINATED = range(4)

_MAGIC = b"TSFMU\0\0\1"
_HEAD = struct.Struct("<8s32sI")
_BODY = struct.Struct("<BBdddI")
_INITIALIZED, _TOLERANCE_SET, _PENDING = 1, 2, 4


class StateError(Exception):
    """Bytes that are not a state of this FMU."""


@dataclass
class State:
    """mode: of the life cycle; start, time, stop: s; initialized: a start has been computed; tolerance_set: by the
    host, so that fmi2SetupExperiment does not change it; pending: the next step is to be discarded; refused: value
    references whose last value was refused.
    """

    mode: int = INSTANTIATED
    start: float = 0.0
    time: float = 0.0
    stop: float = math.inf
    initialized: bool = False
    tolerance_set: bool = False
    pending: bool = False
    refused: set[int] = field(default_factory=set)

    def pack(self, identity: bytes, kernel: bytes) -> bytes:
        flags = _INITIALIZED * self.initialized | _TOLERANCE_SET * self.tolerance_set | _PENDING * self.pending
        body = _BODY.pack(self.mode, flags, self.start, self.time, self.stop, len(self.refused))
        body += struct.pack(f"<{len(self.refused)}I", *sorted(self.refused)) + kernel
        return _HEAD.pack(_MAGIC, identity, zlib.crc32(body)) + body

    @classmethod
    def unpack(cls, identity: bytes, data: bytes) -> tuple[State, bytes]:
        """The state and the kernel's bytes.  Raises StateError."""
        if len(data) < _HEAD.size + _BODY.size:
            raise StateError("it is too short")
        magic, other, checksum = _HEAD.unpack_from(data)
        if magic != _MAGIC:
            raise StateError("it is no state of this version")
        if other != identity:
            raise StateError("it belongs to another FMU")
        body = data[_HEAD.size :]
        if zlib.crc32(body) != checksum:
            raise StateError("it is damaged")
        mode, flags, start, time, stop, count = _BODY.unpack_from(body)
        at = _BODY.size + 4 * count
        refused = set(struct.unpack_from(f"<{count}I", body, _BODY.size))
        state = cls(
            mode=mode,
            start=start,
            time=time,
            stop=stop,
            initialized=bool(flags & _INITIALIZED),
            tolerance_set=bool(flags & _TOLERANCE_SET),
            pending=bool(flags & _PENDING),
            refused=refused,
        )
        return state, body[at:]
