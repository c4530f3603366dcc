"""The article's equations in NumPy, and their integration by SciPy: the reference, which never uses the kernel."""

from __future__ import annotations

from .run import simulate

__all__ = ["simulate"]
