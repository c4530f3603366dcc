"""The page in a real browser without a graphics card: it draws, plays, is pulled, snaps, says what explodes, and complains of
nothing."""

from __future__ import annotations

import io
import itertools

import numpy as np
import pytest
from PIL import Image

from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output.page import write_page
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.support import element_scenes, push, scene
from tests.support.browser import CHROMIUM, Browser
from tests.support.driven_scenes import AFLOAT, LABORATORY, PENDULUM, POLE, built
from tests.support.rigged_scenes import RIGGED
from tests.support.tools import PAGE

pytestmark = [CHROMIUM, PAGE, pytest.mark.usefixtures("made_page")]
APP = "window.tensegrity"
END = f"{APP}.record.frames.at(-1)"
#: Where a node is on the screen.
PLACE = f"""(node => {{
    const box = {APP}.stage.canvas.getBoundingClientRect(), [x, y] = {APP}.stage.project({APP}.structure.node(node));
    return [box.left + x, box.top + y];
}})"""


@pytest.fixture(scope="module")
def pages(made_page, tmp_path_factory):
    """Name -> file: live pages of scenes, and a run."""
    folder = tmp_path_factory.mktemp("pages")
    found = {name: folder / f"{name}.html" for name in ("three_bar_nsh", "two_bar_nsh", "six_bar_nsh")}
    for name, path in found.items():
        write_page(path, scene(name))
    model = scene("three_bar_nsh")
    force = push(model)
    found["run"] = folder / "run.html"
    write_page(found["run"], model, simulate(model, held(model, grid(1.0, 0.01), force=lambda t: force)), force)
    return found


@pytest.fixture(scope="module")
def browser():
    with Browser() as one:
        yield one


@pytest.fixture
def opened(browser, pages):
    """opened(name): the browser with that page; at the end it has complained of nothing."""

    def show(name, hash=""):
        browser.open(pages[name], hash=hash)
        browser.wait(f"{APP} && {APP}.intervals.length > 2")
        return browser

    browser.problems.clear()
    yield show
    assert not browser.problems


def drag(browser, node, dx, dy, held="true"):
    """Pull a node with the mouse, and keep the button down until an expression is true."""
    browser.run(f"{APP}.play(false)")  # else the node goes on while the pointer goes there; a pull lets it run again
    browser.wait(f"!{APP}.stale")
    x, y = browser.run(f"{PLACE}({node})")
    browser.mouse("mouseMoved", x, y)
    browser.mouse("mousePressed", x, y, 1)
    for part in np.linspace(0.1, 1.0, 10):
        browser.mouse("mouseMoved", x + part * dx, y + part * dy, 1)
    browser.wait(held)
    return x + dx, y + dy


def colours(browser) -> int:
    """How many colours the picture of the structure has."""
    left, top, width, height = browser.run(
        f"(b => [b.left, b.top, b.width, b.height])({APP}.stage.canvas.getBoundingClientRect())"
    )
    picture = Image.open(io.BytesIO(browser.picture())).convert("RGB")
    box = picture.crop((int(left), int(top), int(left + width), int(top + height)))
    return len(box.getcolors(1 << 24))


@pytest.mark.parametrize("hash", ["", "#webgl"])
@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar_nsh"])
def test_it_draws_and_runs_at_rest(opened, name, hash):
    """On a plain canvas, and by WebGL, which software plays here."""
    page = opened(name, hash)
    assert page.run(f"{APP}.stage.flat") == (not hash) and page.run(f"{APP}.stage.renderer.isWebGLRenderer ?? false") == bool(
        hash
    )
    page.wait(f"{APP}.time > 0.2")
    assert page.run(f"{APP}.playing") and page.run(f"{APP}.live.failure") is None
    assert colours(page) > 60
    start = np.array(scene(name).nodes)
    now = np.array(page.run(f"[...{APP}.structure.places]")).reshape(-1, 3)
    np.testing.assert_allclose(now, start, atol=1e-9)  # in equilibrium


@pytest.mark.parametrize("name, node", [("three_bar_nsh", 3), ("two_bar_nsh", 3), ("six_bar_nsh", 11)])
def test_a_node_follows_the_pointer_and_honeycombs_snap(opened, name, node):
    page = opened(name)
    page.wait(f"{APP}.time > 0.05")
    before = page.run(f"[...{APP}.structure.places].slice({3 * node}, {3 * node + 3})")
    x, y = drag(page, node, 30, -130, f"Math.max(...{END}.snapped) > 0 && {APP}.time > 1")
    after = page.run(f"[...{APP}.structure.places].slice({3 * node}, {3 * node + 3})")
    assert after[2] > before[2] + 0.02
    assert page.run(f"{APP}.live.pull.node") == node and max(map(abs, page.run(f"[...{END}.force]"))) > 1.0
    assert page.run(f"{APP}.record.transitions.length") > 0
    page.mouse("mouseReleased", x, y)
    page.wait(f"{APP}.live.pull === null")
    drawn = page.run(f"{APP}.structure.full.count")
    assert drawn == page.run(f"{APP}.honeycombs.snapped.flat().filter(Boolean).length")
    snapped = page.run(f"{APP}.honeycombs.snapped")
    assert all(one == sorted(one, reverse=True) for one in snapped)  # the article's beams stand in the order of their strength
    gap = page.run(f"Math.abs(Number.parseFloat({APP}.panel.gap.textContent))")
    assert gap < 1e-6  # J


def models():
    """What the built-in scenes have not: no strings, no ground, other planes, motors, moved nodes, memory, laws of any kind,
    strings over several nodes."""
    yield from map(built, (PENDULUM, AFLOAT, LABORATORY, RIGGED))
    yield from map(element_scenes.mast, ("memory", "mixed"))
    for axes in ("xy", "yz"):
        strings = {name: {"nodes": [node, "n2"], "material": "cable"} for name, node in (("s1", "n3"), ("s2", "n4"))}
        yield built(POLE, name=axes, plane=axes, gravity=0.0, strings=strings, prestress={"tension": {"s2": 25.0}})


def test_structures_of_any_kind_are_drawn_and_pulled(browser, tmp_path):
    for model in models():
        path = tmp_path / f"{model.name}.html"
        write_page(path, model)
        browser.problems.clear()
        browser.open(path)
        browser.wait(f"{APP} && {APP}.intervals.length > 2")
        start = browser.run(f"{APP}.time")
        node = int(model.free_nodes[-1])
        x, y = drag(browser, node, 40, -60, f"{APP}.time > {start} + 0.3 || {APP}.live.failure")
        force = max(map(abs, browser.run(f"[...{END}.force]")))
        browser.mouse("mouseReleased", x, y)
        browser.run(f"{APP}.names = 2; {APP}.show.reactions = true; {APP}.choose({{kind: 'node', index: {node}}})")
        browser.wait(f"{APP}.time > {start} + 0.6 || {APP}.live.failure")
        assert browser.run(f"{APP}.live.failure") is None and force > 0.0, model.name
        assert browser.run("document.getElementById('notice').hidden"), model.name
        assert not browser.problems, model.name


def test_what_follows_is_the_librarys_motion(opened):
    """A page's run under a constant force, frame by frame, is the library's under the same communication steps."""
    page = opened("three_bar_nsh")
    model = scene("three_bar_nsh")
    page.run(f"(a => {{ a.playing = false; a.live.held[2] = 45; a.restart(); a.live.advance(1, 1e6); }})({APP})")
    page.wait(f"{APP}.record.end >= 0.99")
    times = np.array(page.run(f"{APP}.record.frames.map(f => f.time)"))
    found = np.array(page.run(f"{APP}.record.frames.map(f => [...{APP}.model.of(f, 'position')])"))
    force = np.zeros((6, 3))
    force[3, 2] = 45.0
    count = round(times[-1] * 240)
    native = simulate(model, held(model, np.arange(count + 1) / 240.0, force=lambda t: force))
    np.testing.assert_allclose(times, native.times[np.round(times * 240).astype(int)], atol=1e-9)
    wanted = native.position[np.round(times * 240).astype(int)].reshape(len(times), -1)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-10)  # steps of 1/240 s and their sums round differently


def test_rk4_with_a_long_step_explodes_and_the_page_says_so(opened):
    page = opened("three_bar_nsh")
    page.run(f"{APP}.panel.setMethod('rk4', 0.01)")
    page.run(f"(a => {{ a.live.held[2] = 45; a.restart(); a.play(true); }})({APP})")
    page.wait(f"{APP}.live.failure")
    assert "rk4 with a step of 10 ms has exploded" in page.run("document.getElementById('notice').textContent")
    assert not page.run(f"{APP}.playing")
    page.run("document.querySelector('#notice button').click()")
    page.run(f"{APP}.panel.setMethod('auto', 0.01)")
    page.run(f"{APP}.play(true)")
    page.wait(f"{APP}.time > 0.1")
    assert page.run(f"{APP}.live.failure") is None and page.run("document.getElementById('notice').hidden")


def test_a_rest_length_that_would_become_negative_is_named(opened):
    page = opened("three_bar_nsh")
    page.run(f"{APP}.live.goal.rest_length[1] = -1; {APP}.live.kernel.field('rest_length')[1] = 1e-4")
    page.run(f"{APP}.play(true)")
    page.wait(f"{APP}.live.failure")
    assert page.run(f"{APP}.live.failure.message").startswith("s2.rest_length = ")
    assert "s2.rest_length" in page.run("document.getElementById('notice').textContent")


def test_time_goes_back_and_on_from_there(opened):
    page = opened("three_bar_nsh")
    page.run(f"{APP}.live.held[2] = 45; {APP}.restart(); {APP}.play(true)")
    page.wait(f"{APP}.time > 1")
    page.key(" ")
    assert not page.run(f"{APP}.playing")
    page.key("Home")
    assert page.run(f"{APP}.time") == 0
    page.key("ArrowRight")
    assert 0.01 < page.run(f"{APP}.time") < 0.03
    page.run(f"{APP}.seek(0.5); {APP}.play(true)")
    page.wait(f"{APP}.record.end > 0.6")
    times = page.run(f"{APP}.record.frames.map(f => f.time)")
    assert all(later > earlier for earlier, later in itertools.pairwise(times))
    assert page.run(f"{APP}.record.transitions.every((t, i, all) => i === 0 || t.time >= all[i - 1].time)")


def test_sliders_change_the_model(opened):
    page = opened("three_bar_nsh")
    heights = f"{APP}.model.of({END}, 'potential')[0]"
    before = page.run(heights)
    page.run("""(row => { const i = row.querySelector('input'); i.value = 0; i.dispatchEvent(new Event('input')); })(
        [...document.querySelectorAll('#change .slider')].find(r => r.textContent.startsWith('Rest lengths')))""")
    page.wait(f"{APP}.time > 1")
    assert page.run(heights) > before + 0.1  # shorter strings lift it
    assert page.run(f"{APP}.live.kernel.field('rest_length')[0]") == pytest.approx(
        0.9 * scene("three_bar_nsh").rest_length[0], rel=1e-9
    )
    page.run("[...document.querySelectorAll('#change button')].at(-1).click()")
    assert page.run(heights) == pytest.approx(before, abs=1e-9)


def test_names_and_numbers_are_shown_on_demand(opened):
    page = opened("three_bar_nsh")
    x, y = page.run(f"{PLACE}(3)")
    for kind in ("mousePressed", "mouseReleased"):
        page.mouse(kind, x, y, int(kind == "mousePressed"))
    page.wait(f"{APP}.chosen")
    assert page.run("document.querySelector('#chosen h3').textContent") == "node n4"
    blank = page.run(f"{APP}.overlay.canvas.toDataURL()")
    page.key("n")
    page.wait(f"{APP}.overlay.canvas.toDataURL() !== {blank!r}")
    page.key("Escape")
    assert page.run(f"{APP}.chosen") is None


def test_names_of_a_crowd_lie_on_no_other_and_one_that_is_chosen_is_there(browser, tmp_path):
    """Of a small scene all names are there; of a tower as many as have room, and more of them nearer by."""
    written = f"{APP}.overlay.taken.map(([x, y, wide]) => [x, y, wide])"
    for model, names in ((scene("three_bar_nsh"), 15), (build_model(tower(10)), 231)):
        path = tmp_path / f"{model.name}.html"
        write_page(path, model)
        browser.problems.clear()
        browser.open(path)
        browser.wait(f"{APP} && {APP}.intervals.length > 2")
        browser.run(f"{APP}.play(false); {APP}.names = 2; {APP}.choose({{kind: 'string', index: 5}})")
        browser.wait(f"{APP}.still")
        assert len(model.node_names) + len(model.bar_names) + len(model.string_names) == names
        width, height = browser.run(f"[{APP}.stage.width, {APP}.stage.height]")
        boxes = browser.run(written)
        assert len(boxes) == names if names < 20 else 40 < len(boxes) < names
        for (x, y, wide), (u, v, other) in itertools.combinations(boxes, 2):
            assert abs(x - u) >= wide + other or abs(y - v) >= 13.0
        for x, y, wide in boxes[1:]:
            assert wide <= x <= width - wide and 6.0 <= y <= height - 6.0
        middle = browser.run(
            f"(a => a.stage.project(a.structure.node(a.model.strings[5][0]).add("
            f"a.structure.node(a.model.strings[5][1])).multiplyScalar(0.5)))({APP})"
        )
        assert np.hypot(boxes[0][0] - middle[0], boxes[0][1] - middle[1]) < 60.0
        assert not browser.problems


def test_a_run_is_played_back_to_its_end(opened):
    page = opened("run")
    page.wait(f"{APP}.time === {APP}.record.end && !{APP}.playing && !{APP}.stale")
    model = scene("three_bar_nsh")
    force = push(model)
    result = simulate(model, held(model, grid(1.0, 0.01), force=lambda t: force))
    now = np.array(page.run(f"[...{APP}.structure.places]")).reshape(-1, 3)
    np.testing.assert_allclose(now, result.position[-1], atol=1e-6)
    assert page.run(f"{APP}.record.transitions.length") == len(result.transitions)
    assert page.run(f"{APP}.live") is None and page.run("document.getElementById('change').hidden")


def test_a_phone_shows_all_of_it(pages):
    with Browser(390, 844, 2.0, dark=True, touch=True) as phone:
        phone.open(pages["six_bar_nsh"])
        phone.wait(f"{APP} && {APP}.intervals.length > 2")
        assert phone.run("document.documentElement.scrollWidth") <= 390
        assert phone.run("document.documentElement.dataset.theme") == "dark"
        x, y = phone.run(f"{PLACE}(11)")
        phone.touch("touchStart", (x, y))
        for part in range(1, 6):
            phone.touch("touchMove", (x + 4 * part, y - 15 * part))
        phone.wait(f"{APP}.live.pull && Math.max(...{END}.force) > 1")
        phone.touch("touchEnd")
        phone.wait(f"{APP}.live.pull === null")
        corners = phone.run(f"""[...{APP}.model.nodes.keys()].map(n => {APP}.stage.project({APP}.structure.node(n)))""")
        width, height = phone.run(f"[{APP}.stage.width, {APP}.stage.height]")
        assert all(0 < x < width and 0 < y < height for x, y, _ in corners)  # nothing is cut off
        assert not phone.problems
