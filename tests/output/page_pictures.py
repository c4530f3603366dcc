"""Pictures of pages, and how long their frames take, where software draws: `python -m tests.output.page_pictures`.

It writes docs/figures/view_*.png and report_*.png, and docs/view.json with the times, the machine and the commit; look at the
pictures.  --times: measures only; --pictures: takes pictures only.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.harness.machine import describe
from fmu_src import builds
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
TIMES = 5  # a drag is begun
#: Width and height of a window, pixels, and pixels of the screen in each of them.
DESK, PHONE = (1280, 800, 1.0), (390, 844, 2.0)


def shrunk(picture: bytes, width: int) -> bytes:
    """The picture in at most 256 colours and of this width."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=3, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


#: In the page: how long after the first move of a pointer that is down the first frame is drawn in which something pulls, ms.
ANSWER = f"""(a => {{
    let moved = null;
    a.stage.canvas.addEventListener('pointermove', e => {{ if (e.buttons && moved === null) moved = performance.now(); }});
    const look = () => {{
        const pulls = a.record.frames.at(-1).force?.some(one => one !== 0);
        if (moved !== null && pulls && a.drawn >= moved) window.answered = performance.now() - moved;
        else requestAnimationFrame(look);
    }};
    requestAnimationFrame(look);
}})({APP})"""


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


def answer(page: Browser, node: int) -> float:
    """From the pointer's first move to the first frame that shows the pull, ms: the median of TIMES drags."""
    found = []
    for _ in range(TIMES):
        page.run(f"window.answered = null; {APP}.restart(); {APP}.play(true)")
        page.wait(f"{APP}.time > 0.2")
        page.run(ANSWER)
        x, y = drag(page, node, 30, -110, "window.answered !== null")
        found.append(page.run("window.answered"))
        page.mouse("mouseReleased", x, y)
        page.wait(f"{APP}.live.pull === null")
    return sorted(found)[TIMES // 2]


def models() -> dict[str, Model]:
    return {"six_bar_nsh": scene("six_bar_nsh"), "tower of 30 bars": build_model(tower(10))}


def view_pictures(folder: Path) -> None:
    """Write docs/figures/view_*.png: pages at rest, and with a node pulled until honeycombs snap, on a desk and on a phone."""
    views = {
        "desktop": ("three_bar_nsh", 3, DESK, {}, (35, -150)),
        "plane": ("two_bar_nsh", 3, DESK, {"dark": True}, (70, -120)),
        "phone": ("six_bar_nsh", 11, PHONE, {"dark": True}, (12, -60)),
    }
    for name, (known, node, size, options, away) in views.items():
        path = folder / f"{known}.html"
        write_page(path, scene(known))
        with Browser(*size, **options) as page:
            page.open(path)
            page.wait(f"{APP} && {APP}.intervals.length > 10 && {APP}.time > 1")
            page.run(f"{APP}.names = 1; {APP}.play(false)")
            page.wait(f"{APP}.still")
            if name != "plane":
                keep(page, f"view_{name}_rest")
            page.run(f"{APP}.restart()")
            drag(page, node, *away, f"Math.max(...{END}.snapped) > 1 && {APP}.time > 3")
            page.run(f"{APP}.play(false)")  # the pull stays
            page.wait(f"{APP}.still")
            keep(page, f"view_{name}")


def report_pictures(folder: Path) -> None:
    """Write docs/figures/report_*.png: the head of a validation report."""
    builds.built(builds.Options(("three_bar_nsh",), ("native",), output=folder))
    for name, (width, height, scale) in {"desktop": (1280, 1180, 1.0), "phone": (390, 1180, 2.0)}.items():
        with Browser(width, height, scale, touch=scale > 1.0) as page:
            page.open(folder / "native" / "three_bar_nsh.html", ready="document.readyState === 'complete'")
            time.sleep(3.0)  # the scene in the report's frame runs for a while
            keep(page, f"report_{name}")


def keep(page: Browser, name: str) -> None:
    """What a page shows, as a figure of the docs."""
    width = 480 if "phone" in name else 1000
    write_bytes(ROOT / "docs" / "figures" / f"{name}.png", shrunk(page.picture(), width))


def with_table(page: str, found: dict[str, Any]) -> str:
    """The page with the table of these times between its marks."""
    head, rest = page.split(MARKS[0])
    _, tail = rest.split(MARKS[1])
    rows = [
        f"| {name} | {one['opened']:.0f} | {one['answer']:.0f} | {one['between'][0]:.0f} | {one['between'][1]:.0f} | "
        f"{one['work'][0]:.0f} | {one['pace']:.2f} | {one['bytes'] / 1e6:.2f} |"
        for name, one in found["times"].items()
    ]
    table = (
        "| | first picture after, ms | a pull is seen after, ms | from picture to picture, ms: median | 95 of 100 within "
        "| work of the page in it | simulated s per s | page, MB |\n|---|---|---|---|---|---|---|---|\n"
    )
    machine = f"{found['machine']['processor']}, commit {found['machine']['commit']}, {found['machine']['date']}"
    busy = f"the mean load was {found['load']:g} before"
    return head + MARKS[0] + table + "\n".join(rows) + f"\n\n({machine}; {busy}.)\n" + MARKS[1] + tail


def measured() -> dict[str, Any]:
    """Times of pages by scene."""
    times: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, model in models().items():
            path = Path(folder) / "page.html"
            size = write_page(path, model)
            with Browser() as page:
                page.open(path, ready=f"{APP}?.drawn")
                opened = page.run("performance.now()")
                page.wait(f"{APP}.intervals.length > 30")
                times[name] = {"opened": opened} | frames(page, int(model.free_nodes[-1])) | {"bytes": size}
                times[name]["answer"] = answer(page, int(model.free_nodes[-1]))
                times[name]["problems"] = page.problems
                print(name, times[name], flush=True)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--pictures", action="store_true", help="draw, measure nothing")
    only.add_argument("--times", action="store_true", help="measure, draw nothing")
    options = parser.parse_args()
    if not options.times:
        with tempfile.TemporaryDirectory() as folder:
            view_pictures(Path(folder))
            report_pictures(Path(folder))
    if not options.pictures:
        busy = round(os.getloadavg()[0], 1)
        found = {"times": measured(), "load": busy, "machine": describe()}
        write_text(DATA, json.dumps(found, indent=1) + "\n")
        write_text(PAGE, with_table(PAGE.read_text(encoding="utf-8"), found))


if __name__ == "__main__":
    main()
