"""One web page that is a model: it draws a structure, and runs the kernel itself, or plays a run back; it needs no network."""

from __future__ import annotations

from .document import page, write_page
from .fmu import model_of_fmu
from .made import Parts, found, parts
from .series import result_of_file

__all__ = ["Parts", "found", "model_of_fmu", "page", "parts", "result_of_file", "write_page"]
