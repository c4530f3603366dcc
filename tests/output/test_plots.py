"""Pictures: what is drawn stands where the structure does, and a film shows the motion."""

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from tensegrity_core.errors import InputError
from tensegrity_core.kernel import simulate
from tensegrity_core.model import NSH, grid, held
from tensegrity_core.output import drawing, film, plots
from tests.support import by_hand, push, scene

SCENES = ("two_bar_nsh", "three_bar", "six_bar_nsh")


@pytest.fixture(scope="module")
def lifted():
    """three_bar_nsh under a lift for 0.4 s: model, force (N, 3), result."""
    model = scene("three_bar_nsh")
    force = push(model)
    return model, force, simulate(model, held(model, grid(0.4, 0.1), force=lambda t: force), tolerance=1e-6)


def points_of(line, model):
    """(n, 3) data of a line; the axis that a planar scene does not use is zero."""
    data = np.transpose(line.get_data_3d() if len(model.axes) == 3 else line.get_data())
    found = np.zeros((len(data), 3))
    found[:, list(model.axes)] = data
    return found


def drawn(model, nodes=None, **state):
    figure = plots.new_figure(200, 200)
    made = drawing.draw(drawing.new_axes(figure, model), model)
    made.move(model.nodes if nodes is None else nodes, **state)
    return made


def lines(made, color, linestyle=None):
    return [
        line
        for line in made.axes.lines
        if line.get_color() == color and len(points_of(line, made.model)) and linestyle in (None, line.get_linestyle())
    ]


@pytest.mark.parametrize("name", SCENES)
def test_members_end_at_their_nodes(name):
    model = scene(name)
    shift = np.zeros(3)
    shift[list(model.axes)] = 0.1
    made = drawn(model, model.nodes + shift)
    ends = [points_of(line, model) for line in lines(made, drawing.BAR)]
    np.testing.assert_allclose(ends, (model.nodes + shift)[model.bars])
    plain = [i for i, nsh in enumerate(model.nsh) if nsh is None]
    ends = [points_of(line, model) for line in lines(made, drawing.STRING)]
    np.testing.assert_allclose(ends, (model.nodes + shift)[model.strings[plain]])
    ends = [points_of(line, model)[[0, -1]] for line in lines(made, drawing.NSH)]
    expected = (model.nodes + shift)[model.strings[list(model.nsh_strings)]]
    np.testing.assert_allclose(np.reshape(ends, (-1, 2, 3)), expected)


@pytest.mark.parametrize("name", SCENES)
def test_fixed_nodes_are_marked(name):
    model = scene(name)
    marks = [points_of(line, model)[0] for line in lines(drawn(model), drawing.SUPPORT)]
    np.testing.assert_allclose(marks, model.nodes[model.fixed])


@pytest.mark.parametrize("name", SCENES)
def test_all_axes_have_one_scale(name):
    model = scene(name)
    axes = drawn(model).axes
    if len(model.axes) == 2:
        assert axes.get_aspect() == 1.0
        return
    spans = np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()), np.ptp(axes.get_zlim())])
    box = axes._box_aspect  # Matplotlib has no public way to ask
    np.testing.assert_allclose(box / box[0], spans / spans[0])


def test_the_nearer_bar_covers_the_farther_one():
    made = drawn(scene("three_bar"))
    eye = drawing._eye(made.axes)
    bars = lines(made, drawing.BAR)
    nearness = [points_of(line, made.model).mean(axis=0) @ eye for line in bars]
    order = [line.get_zorder() for line in bars]
    assert np.array_equal(np.argsort(nearness), np.argsort(order))


def test_slack_strings_are_dashed():
    model = scene("three_bar")
    slack = np.array([True, False, False, True, False, False])
    dashed = [line.get_linestyle() == "--" for line in lines(drawn(model, slack=slack), drawing.STRING)]
    assert dashed == slack.tolist()
    squeezed = model.nodes * [0.5, 0.5, 1.0]  # every string is shorter than its rest length
    assert len(lines(drawn(model, squeezed), drawing.STRING, "--")) == 6


def test_routed_strings_are_drawn_along_their_way():
    """Dashed where shorter than their rest length, unless they also push; a zigzag stands on the longest segment."""
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 2.0], [0.0, 0.0, 1.0]])
    honeycomb = NSH((6.0,), (4.0,), (0.01,))
    fields = {"axes": (0, 2), "stiffness": 100.0, "rest_length": [9.0, 9.0, 4.0], "two_way": [False, True, False]}
    masses = [(node, 1.0) for node in (1, 2, 3)]
    paths = [(0, 1, 2, 3, 0), (0, 2, 1), (0, 1, 2, 3)]
    model = by_hand(nodes, [0], [], paths, point_mass=masses, nsh=(None, None, honeycomb), **fields)
    made = drawn(model)
    for line, path, style in zip(made._strings, paths[:2], ("--", "-")):
        np.testing.assert_array_equal(points_of(line, model), nodes[list(path)])
        assert line.get_linestyle() == style
    path = points_of(made._strings[2], model)
    np.testing.assert_array_equal(path[[0, 1, -2, -1]], nodes[[0, 1, 2, 3]])
    assert len(path) == 7 and (path[2:-2, 2] > 0.5).all() and (path[2:-2, 2] < 1.5).all()
    result = simulate(model, held(model, grid(0.02, 0.01)))
    assert drawing.slack_strings(result, model)[0].tolist() == [True, False, False]


def test_beads_count_the_beams_that_snapped():
    model = scene("three_bar_nsh")
    made = drawn(model, snapped=np.array([0, 1, 4]))
    filled = [len(points_of(full, model)) for _, full in made._beads]
    empty = [len(points_of(hollow, model)) for hollow, _ in made._beads]
    assert filled == [0, 1, 4] and empty == [4, 3, 0]


def test_the_zigzag_takes_up_the_elongation():
    model = scene("two_bar_nsh")
    s = model.nsh_strings[0]
    ends = model.nodes[model.strings[s]]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    made = drawn(model)

    def ropes(ends):
        """Lengths of the straight parts at both sides of the zigzag."""
        path, _ = made._zigzag(s, ends)
        return np.linalg.norm(path[1] - path[0]), np.linalg.norm(path[-1] - path[-2])

    longer = np.array([ends[0], ends[1] + 0.05 * along])
    np.testing.assert_allclose(ropes(longer), ropes(ends), rtol=1e-12)


def test_arrows_start_at_the_nodes_and_show_the_forces():
    model = scene("three_bar")
    force = np.zeros((6, 3))
    force[3] = 30.0, 0.0, 40.0
    (arrow,) = lines(drawn(model, force=force, metres_per_newton=0.01), drawing.LOAD)
    tail, tip = points_of(arrow, model)[:2]
    np.testing.assert_allclose([tail, tip], [model.nodes[3], model.nodes[3] + [0.3, 0.0, 0.4]])


def test_plot_shows_every_series_with_its_unit(lifted):
    model, _, result = lifted
    panels = plots.plot(model, result).axes
    assert [panel.get_ylabel() for panel in panels] == ["x in m", "y in m", "z in m", "string force in N"]
    assert panels[-1].get_xlabel() == "time in s"
    for axis, panel in enumerate(panels[:3]):
        shown = np.transpose([line.get_ydata() for line in panel.lines])
        np.testing.assert_array_equal(shown, result.position[:, model.free_nodes, axis])
    np.testing.assert_array_equal(np.transpose([line.get_ydata() for line in panels[-1].lines]), result.string_force)
    names = [text.get_text() for text in panels[-1].get_legend().get_texts()]
    assert names == list(model.string_names)


def test_a_film_has_a_frame_per_sample_and_moves(lifted, tmp_path):
    model, force, result = lifted
    path = tmp_path / "film.gif"
    film.animate(model, result, path, frames_per_second=10, force=np.tile(force, (5, 1, 1)), size=(160, 120))
    with Image.open(path) as shown:
        assert (shown.size, shown.n_frames, shown.info["duration"], shown.info["loop"]) == ((160, 120), 5, 100, 0)
        frames = []
        for k in range(5):
            shown.seek(k)
            frames.append(np.asarray(shown.convert("RGB"), dtype=int))
    assert all(np.any(a != b) for a, b in pairwise(frames))
    assert frames[0][2, 2].tolist() == [255, 255, 255]
    dark = frames[0].sum(axis=2) < 200
    assert 0.01 < dark.mean() < 0.2, "the bars of the structure"
    assert [p.name for p in tmp_path.iterdir()] == ["film.gif"]


def test_a_film_is_the_same_each_time(lifted, tmp_path):
    model, _, result = lifted
    for name in ("a.gif", "b.gif"):
        film.animate(model, result, tmp_path / name, size=(100, 100))
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_film_that_fails_leaves_nothing(tmp_path):
    figure = plots.new_figure(20, 20)
    (tmp_path / "old.gif").write_bytes(b"old")

    def fail(k):
        raise RuntimeError("no frame")

    with pytest.raises(RuntimeError, match="no frame"):
        film.write_frames(figure, tmp_path / "old.gif", 3, fail, 20)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("old.gif", b"old")]


def test_a_film_needs_the_right_suffix(lifted, tmp_path):
    model, _, result = lifted
    with pytest.raises(InputError, match="does not end in .gif"):
        film.animate(model, result, tmp_path / "film.mp4")
