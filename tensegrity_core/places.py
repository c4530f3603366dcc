"""Where the project's own files are: those beside the sources of a clone, and those that can be made anew."""

from __future__ import annotations

from pathlib import Path

import platformdirs

HERE = Path(__file__).parent
#: The distribution's name: of the installed package, and in a clone's pyproject.toml.
DISTRIBUTION = "tensegrity-fmu"


def clone(package: Path = HERE) -> Path | None:
    """The clone, or the unpacked source archive, that a package's folder stands in; None where the package is installed."""
    project = package.parent / "pyproject.toml"
    if project.is_file() and f'name = "{DISTRIBUTION}"' in project.read_text(encoding="utf-8", errors="replace"):
        return package.parent
    return None


def kept(package: Path = HERE) -> Path:
    """Folder for what takes long to make and can be made anew, which may not exist: build/ of a clone, or the user's cache."""
    root = clone(package)
    return root / "build" if root else Path(platformdirs.user_cache_dir(DISTRIBUTION, appauthor=False))
