"""Scene files: their syntax, the message for each mistake, their schema; and the scenes of towers."""

from __future__ import annotations

from .entries import Scene
from .files import BUILTIN_SCENES, SCENE_FOLDER, is_file, read
from .loading import builtin_scenes, load_scene, parse_scene
from .schema import scene_schema, schema_text

__all__ = [
    "BUILTIN_SCENES",
    "SCENE_FOLDER",
    "Scene",
    "builtin_scenes",
    "is_file",
    "load_scene",
    "parse_scene",
    "read",
    "scene_schema",
    "schema_text",
]
