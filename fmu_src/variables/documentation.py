"""The documentation inside an FMU, and the environment that renders every page of this package."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from tensegrity_core.model import Model

from .arrays import wholes
from .described import LOG_CATEGORIES, Runtime
from .drawing import ICON
from .fmi3_description import TYPES
from .interface import Variable

#: The page in which the model runs, beside index.html.
LIVE = "live.html"


def environment() -> Environment:
    """Templates of fmu_src/templates; everything that is filled in is escaped."""
    return Environment(loader=PackageLoader("fmu_src"), autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def index_html(model: Model, table: tuple[Variable, ...], version: str, runtime: Runtime, live: bool = False) -> bytes:
    """documentation/index.html: what the FMU is, its variables, its equations in brief, its limits.  live: LIVE is there."""
    fmi3 = runtime.standard == "3.0"
    known = {"model": model, "version": version, "runtime": runtime, "fmi3": fmi3, "live": LIVE if live else None}
    known |= {"table": _arrays(table) if fmi3 else table, "picture": ICON if fmi3 else "model.png"}
    fmi = "fmi3" if fmi3 else "fmi2"
    known |= {"fmi": fmi, "categories": {name: text.replace("fmi2", fmi) for name, text in LOG_CATEGORIES.items()}}
    page = environment().get_template("index.html").render(**known)
    return page.encode("utf-8")


def _arrays(table: tuple[Variable, ...]) -> list[Variable]:
    """The table with a row for each variable of FMI 3.0; the start of an array is a text."""
    found = []
    for whole in wholes(table):
        kind = TYPES[whole.first.kind] + (f"[{len(whole.rows)}]" if whole.is_array else "")
        start: Any = whole.first.start
        if whole.is_array and start is not None:
            start = ", ".join(str(row.start) for row in whole.rows)
        found.append(replace(whole.first, name=whole.name, description=whole.description, kind=kind, start=start))
    return found
