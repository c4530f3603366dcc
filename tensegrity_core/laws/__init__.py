"""Force over elongation, exactly, in Python: elements, honeycombs, series, dampers, memory; and all strings at once."""

from __future__ import annotations

from .dampers import damping
from .elements import law, part_law

__all__ = ["damping", "law", "part_law"]
