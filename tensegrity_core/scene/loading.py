"""Scenes from files, texts and the package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..errors import SceneError
from . import files as scene_files
from .checks import CHECKS
from .entries import Scene
from .files import BUILTIN_SCENES, SCENE_FOLDER
from .messages import meant, translated


def builtin_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return BUILTIN_SCENES


def load_scene(name_or_path: str | Path) -> Scene:
    """Load a built-in scene by its name, or any scene by its path (which ends in .toml).

    Raises SceneError for a scene that cannot become a model.
    """
    path = _find(name_or_path)
    raw, origin = scene_files.read(path)
    return _checked({"name": path.stem} | raw, origin, str(path))


def parse_scene(data: dict[str, Any], file: str = "<data>") -> Scene:
    """Check a scene given as nested dicts, the form that the TOML file has; `file` is what error messages call it."""
    if not isinstance(data, dict):
        raise SceneError(file, "(scene)", data, "is not a table", "Give a dict with the keys of a scene file.")
    raw, origin = scene_files.extended(data, Path(file))
    return _checked(raw, origin, file)


def _checked(raw: dict, origin: scene_files.Origin, file: str) -> Scene:
    try:
        scene = Scene.model_validate(raw)
    except ValidationError as failure:
        raise translated(failure, raw, origin, file) from None
    scene._file, scene._raw, scene._origin = file, raw, origin
    for check in CHECKS:
        check(scene)
    return scene


def _find(name_or_path: object) -> Path:
    if not isinstance(name_or_path, str | Path):
        kind = type(name_or_path).__name__
        remedy = "Give the name of a built-in scene, a scene file, or a model such as run.model."
        raise SceneError(kind, "(scene)", kind, "is no scene", remedy)
    text = str(name_or_path)
    if text in BUILTIN_SCENES:
        return SCENE_FOLDER / f"{text}.toml"
    if not text.endswith(".toml"):
        remedy = f"{meant(text, BUILTIN_SCENES)}Give a path that ends in .toml, or one of {', '.join(BUILTIN_SCENES)}."
        raise SceneError(text, "(scene)", text, "is neither a built-in scene nor a .toml file", remedy)
    return Path(text)
