"""Other people's files: structures read from them as scenes, and scenes written as them."""

from __future__ import annotations

from .exported import WRITERS, export_scene
from .imported import READERS, Imported, import_scene

__all__ = ["READERS", "WRITERS", "Imported", "export_scene", "import_scene"]
