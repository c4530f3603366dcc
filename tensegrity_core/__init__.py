"""Tensegrity dynamics with negative stiffness honeycombs (NSH).

One model, two independent implementations: `tensegrity_core.reference` holds the matrix equations in NumPy, integrated
by SciPy; `tensegrity_core.kernel` drives the C kernel.  They share scene data (`tensegrity_core.model`) and nothing else.

Scripts begin with `load`, `simulate`, `equilibrium`, `modes`, `linearize`, `build` and `view`: see `tensegrity_core.api`.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

__all__ = [
    "Equilibrium",
    "Run",
    "build",
    "equilibrium",
    "export_scene",
    "import_scene",
    "linearize",
    "load",
    "modes",
    "read_inputs",
    "scenes",
    "simulate",
    "view",
]


def __getattr__(name: str) -> Any:
    """What scripts use, see api.py: loaded when it is first asked for, as an FMU has this package without it."""
    if name in __all__:
        return getattr(importlib.import_module(f"{__name__}.api"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
