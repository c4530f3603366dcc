"""What an instance knows beyond its kernel, and its form as bytes.

Bytes, little-endian: magic; the FMU's identity (32); CRC-32 of all that follows; mode, flags; start, time, stop (s); the
kernel's state.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass

#: Modes of the life cycle, as bits, so that sets of them are numbers, too.
INSTANTIATED, INITIALIZATION, STEPPING, TERMINATED, ERROR = 1, 2, 4, 8, 16
#: Modes in which values may be set, and read.
SETTING, READING = INSTANTIATED | INITIALIZATION | STEPPING, INITIALIZATION | STEPPING | TERMINATED | ERROR

_MAGIC = b"TSFMU\0\0\2"
_HEAD = struct.Struct("<8s32sI")
_BODY = struct.Struct("<BBddd")
_STALE, _TOLERANCE_SET = 1, 2


class StateError(Exception):
    """Bytes that are not a state of this FMU."""


@dataclass
class State:
    """mode: of the life cycle; start, time, stop: s; stale: outputs are older than inputs (Initialization Mode);
    tolerance_set: by the host, so that fmi2SetupExperiment does not change it; discarded: the last step was; that
    is not saved.
    """

    mode: int = INSTANTIATED
    start: float = 0.0
    time: float = 0.0
    stop: float = math.inf
    stale: bool = False
    tolerance_set: bool = False
    discarded: bool = False

    def pack(self, identity: bytes, kernel: bytes) -> bytes:
        flags = _STALE * self.stale | _TOLERANCE_SET * self.tolerance_set
        body = _BODY.pack(self.mode, flags, self.start, self.time, self.stop) + kernel
        return _HEAD.pack(_MAGIC, identity, zlib.crc32(body)) + body

    @classmethod
    def unpack(cls, identity: bytes, data: bytes, size: int) -> tuple[State, bytes]:
        """The state and the kernel's bytes, of which there are `size`.  Raises StateError."""
        if len(data) < _HEAD.size + _BODY.size:
            raise StateError("it is too short")
        magic, other, checksum = _HEAD.unpack_from(data)
        if magic != _MAGIC:
            raise StateError("it is no state of this version")
        if other != identity:
            raise StateError("it belongs to another FMU")
        if len(data) != _HEAD.size + _BODY.size + size:
            raise StateError("it has been cut or lengthened")
        body = data[_HEAD.size :]
        if zlib.crc32(body) != checksum:
            raise StateError("it is damaged")
        mode, flags, start, time, stop = _BODY.unpack_from(body)
        known = (INSTANTIATED, INITIALIZATION, STEPPING, TERMINATED, ERROR)
        if mode not in known or not math.isfinite(start) or not math.isfinite(time) or math.isnan(stop):
            raise StateError("it is none that an instance comes to")
        state = cls(
            mode=mode,
            start=start,
            time=time,
            stop=stop,
            stale=bool(flags & _STALE),
            tolerance_set=bool(flags & _TOLERANCE_SET),
        )
        return state, body[_BODY.size :]
