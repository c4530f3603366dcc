"""The C kernel: packs a model for it, binds it, runs it.  Nothing here knows a force law."""

from __future__ import annotations

from .binding import LIBRARY, Kernel, load_library
from .packing import fnv1a, to_bytes
from .run import input_rows, simulate

__all__ = ["LIBRARY", "Kernel", "fnv1a", "input_rows", "load_library", "simulate", "to_bytes"]
