"""Where the project's own files are, see tensegrity_core/places.py."""

from __future__ import annotations

from tensegrity_core.places import DISTRIBUTION, clone, kept

__all__ = ["DISTRIBUTION", "clone", "kept"]
