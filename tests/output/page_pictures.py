"""Pictures of pages, and how long their frames take, where software draws: `python -m tests.output.page_pictures`.

It writes docs/figures/view_*.png, and docs/view.json with the times, the machine and the commit; look at the pictures.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.harness.machine import describe
from tensegrity_core.files import write_bytes, write_text
from tensegrity_core.model import Model
from tensegrity_core.output.page import write_page
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.output.test_page_browser import APP, END, drag
from tests.support import scene
from tests.support.browser import Browser

ROOT = Path(__file__).resolve().parents[2]
DATA, PAGE = ROOT / "docs" / "view.json", ROOT / "docs" / "view.md"
MARKS = "<!-- frames -->\n", "<!-- end of frames -->\n"
SECONDS = 4.0  # of which frames are timed
SHARES = (0.5, 0.95)


def shrunk(picture: bytes, width: int) -> bytes:
    """The picture in at most 256 colours and of this width."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=3, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def frames(page: Browser, node: int) -> dict[str, Any]:
    """Times of frames while a node is pulled at real time, ms; pace: simulated s per s."""
    page.run(f"{APP}.intervals.length = {APP}.spent.length = 0")
    x, y = drag(page, node, 30, -110, f"{APP}.time > {SECONDS}")
    found = {
        name: page.run(
            f"(a => {list(SHARES)}.map(p => a[Math.floor(p * (a.length - 1))]))({APP}.{key}.toSorted((a, b) => a - b))"
        )
        for name, key in (("between", "intervals"), ("work", "spent"))
    }
    found |= {"frames": page.run(f"{APP}.intervals.length"), "pace": page.run(f"{APP}.pace")}
    page.mouse("mouseReleased", x, y)
    return found


def models() -> dict[str, Model]:
    return {"six_bar_nsh": scene("six_bar_nsh"), "tower of 30 bars": build_model(tower(10))}


def pictures(folder: Path) -> None:
    """Write docs/figures/view_*.png: a node that is pulled until honeycombs snap, on a desk and on a phone."""
    views = {
        "desktop": ("three_bar_nsh", 3, Browser(1280, 800), (35, -150), 1000),
        "plane": ("two_bar_nsh", 3, Browser(1280, 800, dark=True), (70, -120), 1000),
        "phone": ("six_bar_nsh", 11, Browser(390, 844, 2.0, dark=True), (12, -60), 480),
    }
    for name, (known, node, browser, away, width) in views.items():
        path = folder / f"{known}.html"
        write_page(path, scene(known))
        with browser as page:
            page.open(path)
            page.wait(f"{APP} && {APP}.intervals.length > 10")
            page.run(f"{APP}.names = 1")
            drag(page, node, *away, f"Math.max(...{END}.snapped) > 1 && {APP}.time > 3")
            page.run(f"{APP}.play(false)")  # the pull stays
            page.wait(f"{APP}.still")
            write_bytes(ROOT / "docs" / "figures" / f"view_{name}.png", shrunk(page.picture(), width))


def with_table(page: str, found: dict[str, Any]) -> str:
    """The page with the table of these times between its marks."""
    head, rest = page.split(MARKS[0])
    _, tail = rest.split(MARKS[1])
    rows = [
        f"| {name} | {one['between'][0]:.0f} | {one['between'][1]:.0f} | {one['work'][0]:.0f} | {one['pace']:.2f} |"
        for name, one in found["times"].items()
    ]
    table = "| | median, ms | 95 of 100 within, ms | work of the page in it, ms | simulated s per s |\n|---|---|---|---|---|\n"
    machine = f"{found['machine']['processor']}, commit {found['machine']['commit']}, {found['machine']['date']}"
    return head + MARKS[0] + table + "\n".join(rows) + f"\n\n({machine}.)\n" + MARKS[1] + tail


def main() -> None:
    times: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        pictures(Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        for name, model in models().items():
            path = Path(folder) / "page.html"
            size = write_page(path, model)
            with Browser() as page:
                page.open(path)
                page.wait(f"{APP}.intervals.length > 30")
                times[name] = frames(page, int(model.free_nodes[-1])) | {"bytes": size}
                times[name]["problems"] = page.problems
                print(name, times[name], flush=True)
    if "--times" not in sys.argv:
        found = {"times": times, "machine": describe()}
        write_text(DATA, json.dumps(found, indent=1) + "\n")
        write_text(PAGE, with_table(PAGE.read_text(encoding="utf-8"), found))


if __name__ == "__main__":
    main()
