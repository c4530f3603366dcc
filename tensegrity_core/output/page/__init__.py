"""One web page that is a model: it draws a structure, and runs the kernel itself, or plays a run back; it needs no network."""

from __future__ import annotations

from .document import page, write_page
from .made import Parts, parts

__all__ = ["Parts", "page", "parts", "write_page"]
