"""The documentation inside an FMU, and the environment that renders every page of this package."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from tensegrity_core.model import Model

from .interface import Variable
from .model_description import LOG_CATEGORIES, Runtime

#: The page in which the model runs, beside index.html.
LIVE = "live.html"


def environment() -> Environment:
    """Templates of fmu_src/templates; everything that is filled in is escaped."""
    return Environment(loader=PackageLoader("fmu_src"), autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def index_html(model: Model, table: tuple[Variable, ...], version: str, runtime: Runtime, live: bool = False) -> bytes:
    """documentation/index.html: what the FMU is, its variables, its equations in brief, its limits.  live: LIVE is there."""
    known = {"model": model, "table": table, "version": version, "runtime": runtime, "categories": LOG_CATEGORIES}
    known["live"] = LIVE if live else None
    page = environment().get_template("index.html").render(**known)
    return page.encode("utf-8")
