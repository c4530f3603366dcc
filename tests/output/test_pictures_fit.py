"""Pictures of structures of any kind: nothing is cut off at an edge, names stand apart, and a crowd of them covers nothing."""

from __future__ import annotations

import io
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from PIL import Image

from fmu_src.variables.drawing import model_png
from tensegrity_core.equilibria.modes import Mode
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output import drawing, film, modes_figures, names, plots
from tensegrity_core.scene import builtin_scenes
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.support import element_scenes, push, scene
from tests.support.driven_scenes import AFLOAT, LABORATORY, PENDULUM, POLE, built

#: Scenes of the package, and what they have not: towers, no strings, no ground, other planes, laws of any kind.
MODELS = {name: lambda name=name: scene(name) for name in builtin_scenes()}
MODELS |= {f"tower of {3 * stages} bars": lambda stages=stages: build_model(tower(stages)) for stages in (3, 10, 20)}
MODELS |= {one["name"]: lambda one=one: built(one) for one in (PENDULUM, AFLOAT, LABORATORY, POLE)}
MODELS |= {"mast": lambda: element_scenes.mast("mixed")}
MODELS |= {f"pole in {axes}": lambda axes=axes: built(POLE, name="pole", plane=axes, gravity=0.0) for axes in ("xy", "yz")}
SIZES = ((480, 480), (640, 300), (240, 500))


def require_clear_edge(picture: Image.Image, said: str) -> None:
    pixels = np.asarray(picture.convert("RGB"))
    for edge in (pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]):
        assert edge.min() > 240, f"{said}: something is cut off"
    assert pixels.min() < 100, f"{said}: nothing is there"


def picture(figure) -> Image.Image:
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return Image.open(out)


def extents(made: drawing.Drawing) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, middle and half of the size of all names, pixels."""
    renderer = made.axes.figure.canvas.get_renderer()
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text, _, _ in made._names.shown]
    return [(name, 0.5 * (box.p0 + box.p1), 0.5 * (box.p1 - box.p0)) for name, box in boxes]


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]()


@pytest.mark.parametrize("size", SIZES)
def test_a_structure_fits_its_frame_with_its_names(model, size):
    figure = plots.new_figure(*size)
    made = drawing.draw(drawing.new_axes(figure, model), model, names=True)
    require_clear_edge(picture(figure), model.name)
    seen = drawing.project(made.axes, made._flat(np.vstack((model.nodes, made.floor))))
    assert np.all(seen > 0.0) and np.all(seen < size)
    free = np.array(size) - np.ptp(seen, axis=0)
    assert free.min() < 2.2 * drawing.NAMED_ROOM * figure.dpi / 72.0, "it fills the frame one way"
    written = extents(made)
    for (one, middle, half), (other, middle2, half2) in combinations(written, 2):
        assert np.any(np.abs(middle - middle2) >= half + half2), f"{one} lies on {other}"
    for name, middle, half in written:
        assert np.all(middle - half >= 0.0) and np.all(middle + half <= size), name


@pytest.mark.parametrize("name", builtin_scenes())
def test_all_names_of_a_small_scene_are_there(name):
    model = scene(name)
    made = drawing.draw(drawing.new_axes(plots.new_figure(480, 480), model), model, names=True)
    shown = {text.get_text() for text, _, _ in made._names.shown}
    assert shown == {*model.node_names, *model.bar_names, *model.string_names}


def test_names_of_a_crowd_are_few():
    model = build_model(tower(20))
    made = drawing.draw(drawing.new_axes(plots.new_figure(480, 480), model), model, names=True)
    shown = [text.get_text() for text, _, _ in made._names.shown]
    assert 0.6 * names.FEW <= len(shown) <= names.FEW and set(shown) <= set(model.node_names)


def test_names_move_with_what_they_name():
    model = scene("three_bar_nsh")
    made = drawing.draw(drawing.new_axes(plots.new_figure(480, 480), model), model, names=True)
    before = {name: middle for name, middle, _ in extents(made)}
    shift = np.array([0.02, -0.01, 0.03])
    made.move(model.nodes + shift)
    moved = drawing.project(made.axes, model.nodes + shift) - drawing.project(made.axes, model.nodes)
    for name, middle, _ in extents(made):
        if name in model.node_names:
            np.testing.assert_allclose(middle - before[name], moved[model.node_names.index(name)], atol=0.1)


def test_the_icon_of_an_fmu_fits(model):
    require_clear_edge(Image.open(io.BytesIO(model_png(model))), model.name)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "tower of 60 bars"])
def test_modes_fit_their_panels(name):
    """However far the largest motion goes: each node on its own is the one that moves, along each axis."""
    model = MODELS[name]()
    shapes = np.zeros((6, len(model.nodes), 3))
    for i, shape in enumerate(shapes):
        shape[model.free_nodes[i % len(model.free_nodes)], model.axes[i % len(model.axes)]] = (-1.0) ** i
    found = [Mode(eigenvalue=complex(-1.0, 2.0), shape=shape) for shape in shapes]
    figure = modes_figures.modes_figure(model, found)
    whole = picture(figure)
    for i in range(6):
        left, top = 300 * (i % 3), 330 * (i // 3)
        require_clear_edge(whole.crop((left, top + 30, left + 300, top + 330)), f"{model.name}, mode {i + 1}")


@pytest.mark.parametrize("size", [(200, 160), (160, 240)])
@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar_nsh", "six_bar"])
def test_no_frame_of_a_film_cuts_anything_off(name, size, tmp_path):
    model = scene(name)
    model = replace(model, damping=0.05 * model.damping)
    force = 1.5 * push(model)
    result = simulate(model, held(model, grid(0.6, 0.1), force=lambda t: force), tolerance=1e-6)
    path = tmp_path / "film.gif"
    film.animate(model, result, path, force=np.tile(force, (7, 1, 1)), size=size, names=True)
    with Image.open(path) as frames:
        assert frames.size == size
        for k in range(frames.n_frames):
            frames.seek(k)
            require_clear_edge(frames, f"{name}, frame {k}")
