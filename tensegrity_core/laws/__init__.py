"""Force over elongation, exactly, in Python: beams, elements, series, dampers, memory; and all strings at once."""

from __future__ import annotations

from .dampers import damping
from .elements import law, part_law
from .strings import StringLaw, curved_laws, element_law, slack_branches, string_law

__all__ = ["StringLaw", "curved_laws", "damping", "element_law", "law", "part_law", "slack_branches", "string_law"]
