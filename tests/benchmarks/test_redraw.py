"""One command draws all figures and writes all pages again; here, that it knows of all of them."""

import re
from pathlib import Path

import pytest

from benchmarks import redraw
from tests.support import same_picture

ROOT = Path(__file__).resolve().parents[2]
DOCS, BENCHMARKS = ROOT / "docs", ROOT / "benchmarks"


def test_the_command_knows_every_figure_and_every_written_page():
    drawn = {name for page in redraw.pages() for name in page.figures} | {f"stability_{s.name}" for s in redraw.studies()}
    pages = {
        "view_desktop",
        "view_desktop_rest",
        "view_phone",
        "view_phone_rest",
        "view_plane",
        "report_desktop",
        "report_phone",
        "site_desktop",
        "site_phone",
        "site_theory",
    }
    drawn |= pages  # a browser's: python -m tests.output.page_pictures, and tests.whole.site_pictures
    drawn.add("linear_height")  # the example of docs/linearization.md, tests/whole/test_readme.py
    drawn.add("beam")  # python -m benchmarks.article.beam
    assert {path.name for path in (DOCS / "figures").iterdir()} == {f"{name}.png" for name in drawn}
    shown = {name for page in DOCS.glob("*.md") for name in re.findall(r"\(figures/(\w+)\.png\)", page.read_text("utf-8"))}
    assert shown == drawn, "a figure that no page shows, or one that nothing draws"
    sources = {path: path.read_text(encoding="utf-8") for path in BENCHMARKS.rglob("*.py")}
    for what, known in (("PAGE", redraw.PAGES), ("STUDY", [f"stability.{name}" for name in redraw.STUDIES])):
        having = {path for path, text in sources.items() if re.search(rf"^{what} = ", text, re.MULTILINE)}
        assert having == {BENCHMARKS / f"{name.replace('.', '/')}.py" for name in known}
    assert all((DOCS / page.file).is_file() for page in redraw.pages())


def test_figures_stay_small():
    sizes = [path.stat().st_size for path in (DOCS / "figures").iterdir()]
    assert max(sizes) < 150_000 and sum(sizes) < 2_600_000


@pytest.mark.parametrize("name", ["experiments", "growth", "importers", "model_exchange"])
def test_a_page_and_its_figures_come_from_the_stored_data(name, tmp_path):
    (tmp_path / "data").symlink_to(DOCS / "data")
    (tmp_path / f"{name}.json").symlink_to(DOCS / f"{name}.json")
    redraw.main([name, "--docs", str(tmp_path)])
    (page,) = (page for page in redraw.pages() if page.name == name)
    assert (tmp_path / page.file).read_text(encoding="utf-8") == (DOCS / page.file).read_text(encoding="utf-8")
    for figure in page.figures:
        same_picture(tmp_path / "figures" / f"{figure}.png", DOCS / "figures" / f"{figure}.png")
