"""What every benchmark shares: the page that it writes from its data, its figures, tables and command line.

A benchmark has a `PAGE`: what measures, what draws, what reports.  Its command measures and writes data, figures and page; with
--redraw it writes figures and page again from the stored data, as ``python -m benchmarks.redraw`` does for all.  A study of
docs/stability.md has a `STUDY`, and writes a part of that page between two marker comments.  Every number comes from the data.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import jinja2
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from PIL.PngImagePlugin import PngInfo

from tensegrity_core.files import replacing, write_text
from tensegrity_core.output.export import write_columns
from tensegrity_core.output.plots import few_colours

from . import machine

DOCS = machine.ROOT / "docs"
DPI = 110
BENCHMARKS = machine.ROOT / "benchmarks"
#: What begins a block of Markdown whose lines are not filled.
STAY = ("#", "|", "!", "<", "-", "```")

#: Colours of the figures, and the marker's and the line's width in points.
COLOURS = ("#22252e", "#d1495b", "#1b9aaa", "#edae49", "#6b705c", "#7768ae")
#: A mark for each, so that nothing is told by colours alone.
MARKS = "os^Dvx"
STYLE = {
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


def lettered(axes: np.ndarray) -> None:
    """Panels called a, b, c ... in their titles, without minor ticks."""
    for ax, letter in zip(axes.flat, "abcdefghi"):
        ax.set_title(f"{letter}  {ax.get_title(loc='left')}")
        ax.minorticks_off()


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


def save(figure: Figure, path: Path, dpi: float = DPI) -> None:
    """Write a PNG of 256 colours (half the bytes), without dates, so that equal data give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    said = PngInfo()
    said.add_text("Software", f"Matplotlib {matplotlib.__version__}")
    with replacing(path) as file:
        few_colours(figure, dpi).save(file, "PNG", optimize=True, pnginfo=said)


def write_section(page: Path, name: str, text: str) -> None:
    """Put a study's section on the page, in place of what its markers hold, else at the end; the page's head anew."""
    begin, end = f"<!-- {name}: written by benchmarks/stability/{name}.py -->", f"<!-- end of {name} -->"
    block = f"{begin}\n{text.strip()}\n{end}\n"
    _, mark, rest = (page.read_text(encoding="utf-8") if page.exists() else "").partition("<!-- ")
    before, found, after = (mark + rest).partition(begin)
    if found:
        sections = before + block + after.partition(end + "\n")[2]
    else:
        sections = "\n\n".join(part for part in (before.rstrip("\n"), block) if part)
    page.parent.mkdir(parents=True, exist_ok=True)
    write_text(page, rendered("stability/head") + "\n" + sections)


def shown(value, form: str = "", factor: float | None = None) -> str:
    """A number in a format, times a factor, or a dash where there is none."""
    return "–" if value is None or value != value else format(value if factor is None else factor * value, form)


def all_shown(values: Iterable, form: str = "", factor: float | None = None) -> str:
    """'1, 2, 3'."""
    return ", ".join(shown(value, form, factor) for value in values)


def rendered(name: str, /, **values) -> str:
    """The page, or section, of the template benchmarks/NAME.md, its paragraphs filled to the width.

    Templates have the filters f (see `shown`), all (`all_shown`), listed, number (`plain_number`), short, span and cell
    (`least_and_median`).
    """
    return wrapped(_templates().get_template(f"{name}.md").render(values, name=name.rpartition("/")[2])) + "\n"


@cache
def _templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(BENCHMARKS), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "f": shown,
        "all": all_shown,
        "listed": listed,
        "number": plain_number,
        "short": short,
        "span": span,
        "cell": least_and_median,
    }
    return environment


def short(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def plain_number(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{float(f'{value:.3g}'):.0f}"


def span(counts: Iterable[int]) -> str:
    """'none', or the least and the largest of some counts."""
    low, *_, high = sorted(counts)
    return f"{low} to {high}" if low != high else str(high or "none")


def least_and_median(values: dict | None, scale: float = 1.0) -> str:
    """Of a `summary`, the median in parentheses; a dash where there is none."""
    return "–" if values is None else f"{plain_number(scale * values['min'])} ({plain_number(scale * values['median'])})"


def table(header: str | list[str], rows: Iterable[str | list[str]]) -> str:
    """A Markdown table.  A row is a list of cells, which may hold vertical bars, or a text with ' | ' between its cells."""
    lines = [row.split(" | ") if isinstance(row, str) else row for row in (header, *rows)]
    first, *rest = (" | ".join(cell.replace("|", r"\|") for cell in line) for line in lines)
    return "\n".join(f"| {line} |" for line in [first, " | ".join("---" for _ in lines[0]), *rest])


def paragraphs(*blocks: str) -> str:
    """A page of blocks, those that are empty left out, each filled to the width."""
    return wrapped("\n\n".join(block for block in blocks if block)) + "\n"


def wrapped(text: str, width: int = 124) -> str:
    """Markdown with its paragraphs filled to the width, whatever length the numbers in them have; other blocks stay."""
    parts = re.split(r"^(```.*?^```)$", text, flags=re.MULTILINE | re.DOTALL)
    blocks = [block for i, part in enumerate(parts) for block in ([part] if i % 2 else re.split(r"\n{2,}", part.strip()))]
    return "\n\n".join(
        block if block.startswith(STAY) else textwrap.fill(block, width, break_long_words=False, break_on_hyphens=False)
        for block in blocks
        if block
    )


def listed(texts: list[str]) -> str:
    """'a, b and c'."""
    return " and ".join(part for part in (", ".join(texts[:-1]), *texts[-1:]) if part)


def processor_seconds() -> float:
    """Processor time of this process and of its children, s."""
    return sum(os.times()[:4])


def read_json(path: Path):
    """Data that a benchmark stored."""
    if not path.is_file():
        raise SystemExit(f"--redraw: {path} is missing; run without --redraw first")
    return json.loads(path.read_text(encoding="utf-8"))


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """Column -> values, of a CSV file."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    return dict(zip(head.split(","), np.array([line.split(",") for line in lines], dtype=float).T))


class Columns(NamedTuple):
    """A page's long series, data["columns"]: name -> column -> values, in files data/PREFIX_NAME.csv; digits: see `plain`,
    None: all of them.  `keep` and `read` are a page's."""

    prefix: str
    digits: int | None = None

    def keep(self, data: dict, path: Path) -> None:
        for name, columns in data["columns"].items():
            kept = {key: x if self.digits is None else np.array(plain(x, self.digits)) for key, x in columns.items()}
            write_columns(kept, path.parent / "data" / f"{self.prefix}_{name}.csv")
        write_json({key: value for key, value in data.items() if key != "columns"}, path)

    def read(self, path: Path) -> dict:
        files = sorted((path.parent / "data").glob(f"{self.prefix}_*.csv"))
        columns = {file.stem.removeprefix(f"{self.prefix}_"): read_columns(file) for file in files}
        return read_json(path) | {"columns": columns}


def write_json(data: dict, path: Path) -> None:
    """Stored compactly, with a line for each object in an object or a list, so that changes can be read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(data, separators=(",", ":")).replace('},"', '},\n"').replace("},{", "},\n{")
    write_text(path, text + "\n")


def command(about: str, options: Mapping[str, int | tuple[int, ...]] = MappingProxyType({})) -> argparse.ArgumentParser:
    """A benchmark's command line.  options: whole numbers, or several, with their defaults."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of pages, with data/ and figures/ in it")
    parser.add_argument("--redraw", action="store_true", help="do not measure: draw and write from the stored data")
    for name, default in options.items():
        parser.add_argument(f"--{name}", type=int, default=default, nargs="+" if isinstance(default, tuple) else None)
    return parser


class Page(NamedTuple):
    """docs/NAME.md (with dashes) and its figures, written from docs/NAME.json.

    about: help of its command; collect(**options): measures the data; report(data): the page; figures: name -> what draws it
    from the data, or has None to draw; options: see `command`; keep(data, path), read(path): where more than one file is kept.
    """

    about: str
    name: str
    collect: Callable[..., dict]
    report: Callable[[dict], str]
    figures: Mapping[str, Callable[[dict], Figure | None]] = MappingProxyType({})
    options: Mapping[str, int | tuple[int, ...]] = MappingProxyType({})
    keep: Callable[[dict, Path], None] = write_json
    read: Callable[[Path], dict] = read_json

    @property
    def file(self) -> str:
        return f"{self.name.replace('_', '-')}.md"

    def redraw(self, docs: Path = DOCS) -> None:
        """Figures and page from the stored data."""
        data = self.read(docs / f"{self.name}.json")
        with style():
            for name, draw in self.figures.items():
                if (figure := draw(data)) is not None:
                    save(figure, docs / "figures" / f"{name}.png")
        write_text(docs / self.file, self.report(data))

    def write(self, docs: Path, redraw: bool, **options) -> None:
        """Measure, unless what was measured is only to be drawn again; write."""
        if not redraw:
            docs.mkdir(parents=True, exist_ok=True)
            self.keep(self.collect(**options), docs / f"{self.name}.json")
        self.redraw(docs)

    def main(self, arguments: list[str] | None = None) -> None:
        """The command."""
        self.write(**vars(command(self.about, self.options).parse_args(arguments)))


def worst(rows: Iterable[dict], got: str, want: str = "theory") -> float:
    """The largest relative difference of what the rows have of one from what they have of the other."""
    return max(abs(row[got] / row[want] - 1.0) for row in rows)


def nothing(data: dict) -> dict:
    """What a template needs besides the data, where that is nothing."""
    return {}


class Study(NamedTuple):
    """A section of docs/stability.md and its figure, written from docs/data/stability_NAME.json.

    words: what the template benchmarks/stability/NAME.md needs besides the data."""

    about: str
    name: str
    measure: Callable[[], dict]
    draw: Callable[[dict], Figure]
    words: Callable[[dict], dict] = nothing

    def stored(self, docs: Path = DOCS) -> dict:
        return read_json(docs / "data" / f"stability_{self.name}.json")

    def section(self, data: dict) -> str:
        return rendered(f"stability/{self.name}", **data, **self.words(data))

    def redraw(self, docs: Path = DOCS) -> None:
        """Figure and section from the stored data."""
        self.write(self.stored(docs), docs)

    def write(self, data: dict, docs: Path) -> None:
        with style():
            save(self.draw(data), docs / "figures" / f"stability_{self.name}.png")
        write_section(docs / "stability.md", self.name, self.section(data))

    def carry_out(self, docs: Path, ran_on: dict) -> None:
        """Measure and write everything."""
        begun = processor_seconds()
        found = self.measure()
        data = plain({"machine": ran_on, "seconds": processor_seconds() - begun, **found})
        write_json(data, docs / "data" / f"stability_{self.name}.json")
        print(f"{self.name}: {data['seconds']:.0f} s", flush=True)
        self.redraw(docs)

    def main(self, arguments: list[str] | None = None) -> None:
        """The command."""
        studies([self], command(self.about).parse_args(arguments))


def studies(chosen: list[Study], options: argparse.Namespace) -> None:
    """Several, one after the other; all data carry the commit that stood at the beginning."""
    ran_on = {} if options.redraw else machine.describe()
    for study in chosen:
        if options.redraw:
            study.redraw(options.docs)
        else:
            study.carry_out(options.docs, ran_on)
