"""Shared by the studies of docs/stability.md: where results go, how figures are saved, how the page is written.

A study is a script with `measure() -> dict`, `draw(data) -> Figure` and `section(data) -> str`.  `main` runs one and `all.py`
runs all of them; each writes docs/figures/stability_NAME.json (the data, and what it was measured on), .png and .svg, and its
part of docs/stability.md between two marker comments, with every number taken from the data.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import re
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from tensegrity_core.files import replacing, write_text

from . import machine

ROOT = Path(__file__).resolve().parent.parent.parent
DOCS = ROOT / "docs"
DPI = 110
TITLE = "# Stability: where methods fail\n"
INTRODUCTION = """
Every section is written by the script that it names, from the data beside its figure (`figures/stability_*.json`, which
also say what they were measured on). `python -m benchmarks.stability.all` measures everything again, in one order and from
one commit; with `--redraw` it draws figures and sections again from the stored data, as each script does for its own. Points
are measured; what a line is, its panel says. Durations are processor time.
"""

#: Colours of the figures, and the marker's and the line's width in points.
COLOURS = ("#22252e", "#d1495b", "#1b9aaa", "#edae49", "#6b705c", "#7768ae")
STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "stability",
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.grid": True,
    "grid.color": "#e6e4de",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.fontsize": 7,
    "legend.framealpha": 0.85,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "axes.titlelocation": "left",
}


def new_figure(width: float, height: float) -> Figure:
    """width, height: inches.  Use inside `style()`."""
    return Figure(figsize=(width, height), layout="constrained")


def style():
    """Context in which figures are drawn and saved."""
    return matplotlib.rc_context(STYLE)


def plain(value, digits: int = 7):
    """The value with arrays as lists, numbers rounded to that many digits, and what is not finite as None (for JSON)."""
    if isinstance(value, dict):
        return {str(key): plain(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, digits) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), digits)
    if isinstance(value, np.generic):
        return plain(value.item(), digits)
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else None
    return value


def numbers(values) -> np.ndarray:
    """An array of what `plain` wrote; None becomes nan."""
    return np.array(values, dtype=float)


def thinned(times: np.ndarray, rows: np.ndarray, count: int = 240) -> tuple[np.ndarray, np.ndarray]:
    """At most `count` of the rows, about evenly spaced in time, first and last among them."""
    if len(times) <= count:
        return times, rows
    chosen = np.unique(np.searchsorted(times, np.linspace(times[0], times[-1], count)))
    return times[chosen], rows[chosen]


def save(figure: Figure, stem: Path) -> None:
    """Write stem.png (256 colours: half the bytes) and stem.svg, without dates, so that equal data give equal bytes."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    png = io.BytesIO()
    figure.savefig(png, dpi=DPI)
    few = Image.open(png).convert("RGB").quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    with replacing(stem.with_suffix(".png")) as file:  # maximum coverage: a colour that is rare stays
        few.save(file, "PNG", optimize=True)
    svg = io.StringIO()
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    write_text(stem.with_suffix(".svg"), compact(svg.getvalue()))


def compact(svg: str) -> str:
    """The same picture in a third of the bytes: two decimals, and a style that a run of markers shares stands once."""
    svg = re.sub(r"(\d\.\d\d)\d+", r"\1", svg)
    svg = re.sub(r"[ \t]+$|^[ \t]+", "", svg, flags=re.MULTILINE)
    marker = r'<use xlink:href="(?P<id>[^"]*)" x="[^"]*" y="[^"]*" style="(?P<style>[^"]*)"/>\n'
    run = re.compile(marker + r'(?:<use xlink:href="(?P=id)" x="[^"]*" y="[^"]*" style="(?P=style)"/>\n)+')

    def grouped(match: re.Match) -> str:
        return f'<g style="{match["style"]}">\n' + re.sub(r' style="[^"]*"', "", match[0]) + "</g>\n"

    return run.sub(grouped, svg)


def write_section(page: Path, name: str, text: str) -> None:
    """Put a study's section on the page, in place of what its markers hold, else at the end; the page's head anew."""
    begin, end = f"<!-- {name}: written by benchmarks/stability/{name}.py -->", f"<!-- end of {name} -->"
    block = f"{begin}\n{text.strip()}\n{end}\n"
    old = page.read_text(encoding="utf-8") if page.exists() else ""
    sections = old[old.index("<!-- ") :] if "<!-- " in old else ""
    found = re.search(re.escape(begin) + r".*?" + re.escape(end) + r"\n", sections, re.DOTALL)
    if found:
        sections = sections[: found.start()] + block + sections[found.end() :]
    else:
        sections = "\n\n".join(part for part in (sections.rstrip("\n"), block) if part)
    page.parent.mkdir(parents=True, exist_ok=True)
    write_text(page, TITLE + INTRODUCTION + "\n" + sections)


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table; cells may hold vertical bars."""
    first, *rest = (" | ".join(cell.replace("|", r"\|") for cell in row) for row in [header, *rows])
    return "\n".join(f"| {line} |" for line in [first, " | ".join("---" for _ in header), *rest])


def wrapped(text: str, width: int = 124) -> str:
    """Markdown with its paragraphs filled to the width, whatever length the numbers in them have; other blocks stay."""
    blocks = re.split(r"\n{2,}", text.strip())
    return "\n\n".join(
        block if block[0] in "#|!<-" else textwrap.fill(block, width, break_long_words=False, break_on_hyphens=False)
        for block in blocks
    )


def footer(name: str, data: dict) -> str:
    """The last paragraph of a section: the commands, what the data were measured on, and what that took."""
    m = data["machine"]
    versions = f"Python {m['python']}, NumPy {m['numpy']}, SciPy {m['scipy']}"
    return (
        f"Command: `python -m benchmarks.stability.{name}`, to redraw only: `python -m benchmarks.stability.{name} --redraw`. "
        f"Measured on {m['processor']}, {m['system']}, {versions}, commit {m['commit']}, {m['date']}, "
        f"in {data['seconds']:.0f} s."
    )


def processor_seconds() -> float:
    """Processor time of this process and of its children, s."""
    return sum(os.times()[:4])


def stored(name: str, docs: Path = DOCS) -> Path:
    """Where a study's data are."""
    return docs / "figures" / f"stability_{name}.json"


def write(name: str, data: dict, draw: Callable, section: Callable, docs: Path = DOCS) -> None:
    """Draw a study's figure and write its section of the page, from its data."""
    with style():
        save(draw(data), docs / "figures" / f"stability_{name}")
    write_section(docs / "stability.md", name, section(data))


class Arguments(NamedTuple):
    """What the command line of a study says; ran_on: what it is measured on, empty where nothing is measured."""

    redraw: bool
    docs: Path
    ran_on: dict


def arguments(description: str) -> Arguments:
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--redraw", action="store_true", help="do not measure: draw and write from the stored data")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder that receives stability.md and figures/")
    found = parser.parse_args()
    return Arguments(found.redraw, found.docs, {} if found.redraw else machine.describe())


def carry_out(name: str, measure: Callable, draw: Callable, section: Callable, chosen: Arguments) -> None:
    """Measure a study, or read its stored data, and write everything."""
    path = stored(name, chosen.docs)
    if not chosen.redraw:
        begun = processor_seconds()
        data = measure()
        data = plain({"machine": chosen.ran_on, "seconds": processor_seconds() - begun, **data})
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(data, separators=(",", ":")) + "\n")
        print(f"{name}: {data['seconds']:.0f} s", flush=True)
    elif not path.is_file():
        raise SystemExit(f"--redraw: {path} is missing; run without --redraw first")
    write(name, json.loads(path.read_text(encoding="utf-8")), draw, section, chosen.docs)


def main(name: str, measure: Callable, draw: Callable, section: Callable) -> None:
    """Command line of a study: measure and write everything, or with --redraw write everything from the stored data."""
    carry_out(name, measure, draw, section, arguments(sys.modules["__main__"].__doc__))
