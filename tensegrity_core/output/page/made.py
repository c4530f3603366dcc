"""What every page has in common, bundle and kernel: as it came with the package, else made once and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ...errors import TensegrityError
from ...files import replacing_folder
from ...native import build
from ...places import clone, kept
from ...progress import Told, expected
from . import bundle
from .bundle import FILES

#: In a wheel: the made files, beside their sources.
BUILT = Path(__file__).resolve().parent / "built"
#: That it takes to make them, about.
SECONDS = 15.0


class Parts(NamedTuple):
    """template, script, style: texts of the page; kernel: a WebAssembly module."""

    template: str
    script: str
    style: str
    kernel: bytes


def parts(say: Callable[[str], object] = lambda text: None, told: Told | None = None) -> Parts:
    """Template, bundle and kernel.  say: told when they have to be made, which takes up to a minute; told: how far that is.

    Raises TensegrityError where they cannot be made here.
    """
    folder = folder_of_parts(say, told)
    template, script, style = (
        path.read_text(encoding="utf-8")
        for path in (bundle.WEB / bundle.TEMPLATE, folder / bundle.SCRIPT, folder / bundle.STYLE)
    )
    return Parts(template, script, style, (folder / bundle.KERNEL).read_bytes())


def found() -> Path | None:
    """The folder with FILES that came with the package or was made before; None: there is none."""
    places = [_kept()] if clone() else [BUILT, _kept()]
    return next((place for place in places if all((place / name).is_file() for name in FILES)), None)


def _kept() -> Path:
    return kept() / "page" / bundle.digest(build)


def folder_of_parts(say: Callable[[str], object] = lambda text: None, told: Told | None = None) -> Path:
    """The folder with FILES; see `parts`."""
    if folder := found():
        return folder
    folder = _kept()
    if lacking := bundle.missing():
        raise TensegrityError(f"the page is built once from its sources, which takes: pip install {' '.join(lacking)}")
    say("building the page (once; up to a minute) ...")
    try:
        with replacing_folder(folder) as fresh, expected(SECONDS, told):
            bundle.make(fresh, build)
    except (RuntimeError, OSError) as failure:
        remedy = "this takes the npm registry once; a wheel brings the page with it"
        raise TensegrityError(f"the page could not be built: {failure}; {remedy}") from failure
    return folder
