"""NTRT's YAML models: what they mean here, in numbers; mistakes and hostile files.

Every model in a copy of NTRTsim: ``python -m tests.interchange.test_ntrt FOLDER``.
"""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

import tensegrity_core as tc
from tensegrity_core import kernel, reference
from tensegrity_core.cli import main
from tensegrity_core.errors import InputError, TensegrityError
from tensegrity_core.model import grid, held
from tests.support.words import words

PRISM = """
nodes:
  low a: [-5, 0, 0]
  low-b: [5, 0, 0]
  low_z: [0, 0, 8]
  top1: [-5, 5, 0]
  top2: [5, 5, 0]
  top3: [0, 5, 8]
  stray: [9, 9, 9]
pair_groups:
  prism rod:
    - [low a, top2]
    - [low-b, top3]
    - [low_z, top1]
  cable:
    - [low a, top1]
    - [low-b, top2]
    - [low_z, top3]
    - [top1, top2]
    - [top2, top3]
    - [top3, top1]
  wish:
    - [low a, top3]
builders:
  rod: {class: tgRodInfo, parameters: {density: 0.7, radius: 0.3, friction: 0.9}}
  cable: {class: tgBasicActuatorInfo, parameters: {stiffness: 1e3, damping: 20, pretension: 1500, max_tension: 9000}}
"""
STAR = """
nodes:
  middle: [0, 0, 0]
  left: [-2, 0, 1]
  right: [2, 0, 1]
  ahead: [0, 3, 0]
pair_groups:
  rod: [[middle, left], [middle, right], [middle, ahead]]
"""


def written(folder: Path, **texts: str) -> Path:
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return folder / f"{next(iter(texts))}.yaml"


def up(x) -> np.ndarray:
    """NTRT's coordinates in decimetres, y up, as metres with z up."""
    return 0.1 * np.array([x[0], -x[2], x[1]])


def test_a_prism_in_numbers(tmp_path):
    found = tc.import_scene(written(tmp_path, prism=PRISM))
    model = found.model()
    assert model.node_names == ("low_a", "low_b", "lowz", "top1", "top2", "top3")
    np.testing.assert_allclose(model.nodes[0], up([-5, 0, 0]))
    np.testing.assert_allclose(model.nodes[5], up([0, 5, 8]), atol=1e-15)
    lengths = [125**0.5, (25 + 25 + 64) ** 0.5, (25 + 25 + 64) ** 0.5]
    np.testing.assert_allclose(model.bar_mass, [0.7 * pi * 0.09 * length for length in lengths], rtol=1e-14)
    assert set(model.stiffness) == {1000.0} and set(model.damping) == {20.0}
    np.testing.assert_allclose(model.stiffness * (np.linalg.norm(np.diff(model.nodes[model.strings], axis=1)[:, 0], axis=1)
                                                  - model.rest_length), 150.0, rtol=1e-12)  # fmt: skip
    assert (model.damping_law, model.gravity, model.fixed.any()) == ("tension_only", 9.81, np.False_)
    told = "\n".join(found.notes)
    for said in (
        "'low a' is low_a",
        "1 nodes that nothing is built on",
        "friction, max_tension",
        "1 pairs with the tags 'wish'",
    ):
        assert said in told
    again = tc.load(found.save(tmp_path / "prism.toml"))
    assert again == model and (tmp_path / "prism.toml").read_text(encoding="utf-8").startswith(
        "# Lengths of 1 were read as 0.1"
    )
    inputs = held(model, grid(0.05, 0.01))
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    assert np.abs(ours.position - theirs.position).max() < 1e-7


def test_another_unit_scales_lengths_and_forces(tmp_path):
    path = written(tmp_path, prism=PRISM)
    small, large = tc.import_scene(path).model(), tc.import_scene(path, unit=1.0).model()
    np.testing.assert_allclose(large.nodes, 10.0 * small.nodes)
    np.testing.assert_allclose(large.rest_length, 10.0 * small.rest_length)
    np.testing.assert_array_equal(large.bar_mass, small.bar_mass)


def test_rods_that_meet_are_welded_and_rods_without_density_stay(tmp_path):
    spine = """
substructures:
  s1/s2/s3: {path: star.yaml, offset: [0, 0, -4]}
  s3: {translation: [0, 1, 0]}
bond_groups:
  string:
    s1/s2/s3/node_node: [[left, left], [ahead, middle]]
builders:
  rod: {class: tgRodInfo, parameters: {density: 0.5, radius: 1}}
  string: {class: tgBasicActuatorInfo, parameters: {pretension: 10}}
"""
    model = tc.import_scene(written(tmp_path, spine=spine, star=STAR)).model()
    assert [body.bars for body in model.bodies] == [(0, 1, 2), (3, 4, 5), (6, 7, 8)] and len(model.strings) == 4
    at = dict(zip(model.node_names, model.nodes))
    np.testing.assert_allclose(at["s2_ahead"], up([0, 3, -4]), atol=1e-15)
    np.testing.assert_allclose(at["s3_ahead"], up([0, 4, -8]), atol=1e-15)
    held_star = STAR + "builders:\n  rod: {class: tgRodInfo, parameters: {density: 0}}\n"
    frame = "substructures: {a: {path: held.yaml}}\nnodes: {hook: [0, 4, 0], ball: [0, 2, 0]}\n"
    frame += "pair_groups: {string: [[a.ahead, hook], [hook, ball]], rod box: [[hook, ball]]}\nbuilders:\n"
    frame += "  box: {class: tgBoxInfo, parameters: {width: 0.5, height: 2, density: 3}}\n  ball: {class: tgSphereInfo}\n"
    found = tc.import_scene(written(tmp_path, frame=frame.replace("rod box", "box"), held=held_star))
    model = found.model()
    assert model.fixed[[model.node_names.index("a_ahead")]].all() and len(model.bars) == 1
    assert model.bar_mass[0] == pytest.approx(3 * 0.5 * 2 * 2) and model.point_mass[0][1] == pytest.approx(4 / 3 * pi / 8)


def test_children_are_turned_scaled_and_moved(tmp_path):
    whole = """
substructures:
  one:
    path: star.yaml
    rotation: {axis: [0, 0, 2], angle: 90, reference: [0, 0, 0]}
    scale: 2
    translation: [1, 2, 3]
  other: {path: star.yaml, rotation: {axis: [0, 1, 0], angle: 180}, translation: [20, 0, 0]}
"""
    model = tc.import_scene(written(tmp_path, whole=whole, star=STAR)).model()
    at = dict(zip(model.node_names, model.nodes))
    star = {"middle": [0, 0, 0], "left": [-2, 0, 1], "right": [2, 0, 1], "ahead": [0, 3, 0]}
    turned = {name: np.array([-y, x, z]) for name, (x, y, z) in star.items()}
    centre = np.mean(list(turned.values()), axis=0)
    about = np.mean(list(star.values()), axis=0)
    for name, x in star.items():
        np.testing.assert_allclose(at[f"one_{name}"], up(centre + 2 * (turned[name] - centre) + [1, 2, 3]), atol=1e-14)
        other = about + (np.array(x) - about) * [-1, 1, -1] + [20, 0, 0]
        np.testing.assert_allclose(at[f"other_{name}"], up(other), atol=1e-14)


def test_nodes_on_edges(tmp_path):
    """Of the second structure three nodes come to the middles of the first one's edges, and each edge runs over its node."""
    tripod = "nodes: {a: [0, 0, 0], b: [4, 0, 0], c: [0, 0, 4], d: [1, 5, 1]}\n"
    tripod += "pair_groups: {rod: [[a, d], [b, d], [c, d]], string: [[a, b], [b, c], [c, a]]}\n"
    both = """
substructures: {p/q: {path: tripod.yaml}}
bond_groups:
  p/q/node_edge:
    string: [[a/b, a], [b/c, b], [c/a, c]]
"""
    scene = tc.import_scene(written(tmp_path, both=both, tripod=tripod)).tables
    at = {name: np.array(place) for name, place in scene["nodes"].items()}
    ends = [{*string["nodes"]} for string in scene["strings"].values()]
    for edge in ({"p_a", "p_b"}, {"p_b", "p_c"}, {"p_c", "p_a"}, {"q_a", "q_b"}, {"q_b", "q_c"}, {"q_c", "q_a"}):
        assert edge not in ends
    for node, (one, other) in {"q_a": ("p_a", "p_b"), "q_b": ("p_b", "p_c"), "q_c": ("p_c", "p_a")}.items():
        assert {one, node} in ends and {node, other} in ends
    middle = np.mean([at["p_a"], at["p_b"], at["p_c"]], axis=0)
    np.testing.assert_allclose(np.mean([at["q_a"], at["q_b"], at["q_c"]], axis=0), middle, atol=1e-12)
    toward, first = (at["p_a"] + at["p_b"]) / 2 - middle, at["q_a"] - middle
    np.testing.assert_allclose(np.cross(toward, first), 0.0, atol=1e-12)
    assert np.linalg.norm(at["q_a"] - at["q_b"]) == pytest.approx(0.4)


@pytest.mark.parametrize(
    "before, after, says",
    [
        ("[5, 0, 0]", "[5, 0]", "nodes.low-b = a list are not three numbers"),
        ("[5, 0, 0]", "[5, .nan, 0]", "nodes.low-b = nan is not a finite number"),
        ("[low a, top2]", "[low a, top22]", "there is no node 'top22'; did you mean top2"),
        ("[low a, top2]", "[low a]", "pair_groups.prism rod = a list is no list of pairs"),
        ("tgRodInfo", "tgRodinfo", "builders.rod.class = 'tgRodinfo' is not known; classes are tgRodInfo"),
        ("radius: 0.3", "radios: 0.3", "builders.rod.parameters.radios is none of tgRodInfo; these are radius, density"),
        ("radius: 0.3", "radius: -1", "builders.rod.parameters.radius = -1 is less than 0"),
        ("pair_groups:", "pairs:", "'pairs' is no key of a NTRT model; keys are nodes, pair_groups"),
        ("  top1: [-5, 5, 0]", "  top2: [-5, 5, 0]", "'top2' stands twice"),
        ("  low a: [-5", " low a: [-5", "line 4 is not YAML"),
        ("nodes:", "nodes: [", "is not YAML"),
        ("pretension: 1500", "pretension: none", "builders.cable.parameters.pretension = 'none' is not a finite number"),
        ("[low a, top3]", "[top3, top3]", ""),
        ("  wish:", "  prism rod cable:", "is built by cable and by rod"),
    ],
)
def test_mistakes_are_named(before, after, says, tmp_path, capsys):
    assert PRISM.count(before) >= 1
    path = written(tmp_path, prism=PRISM.replace(before, after, 1))
    code = main(["import", str(path), "--output", str(tmp_path / "out.toml")])
    told = capsys.readouterr()
    if says:
        assert code == 2 and says in told.err and told.err.count("\n") == 1 and not (tmp_path / "out.toml").exists()
    else:  # a pair that nothing builds may be anything
        assert code == 0 and "note: 1 pairs with the tags 'wish'" in told.out


@pytest.mark.parametrize(
    "text, says",
    [
        ("substructures: {a: {path: it.yaml}}", "stands in itself"),
        ("substructures: {a: {path: missing.yaml}}", "missing.yaml cannot be read"),
        ("substructures: {a: {}}", "a has no path"),
        ("substructures: {a: {path: [1]}}", "names no file"),
        ("substructures: {a: {path: star.yaml, turn: 3}}", "turn is no attribute of a structure"),
        ("substructures: {a: {path: star.yaml, rotation: {axis: [0, 0, 0], angle: 1}}}", "axis is zero"),
        ("substructures: {a/b: {path: star.yaml}}\nbond_groups: {string: {a/c/node_node: [[left, left]]}}", "there is no c"),
        (
            "substructures: {a/b: {path: star.yaml}}\nbond_groups: {string: {a/b/nodes: [[left, left]]}}",
            "node_node or node_edge",
        ),
        ("substructures: {a/b: {path: star.yaml}}\nbond_groups: {string: {tag: [[left, left]]}}", "not one tag and one bond"),
        (
            "substructures: {a/b: {path: star.yaml}}\nbond_groups: {string: {a/b/node_edge: [[left, left/right]]}}",
            "give three at least",
        ),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nnodes: {n: *c}", "no key of a NTRT model"),
        ("nodes: {n: &n [[1], *n]}", "recursive"),
        ("- 1", "is not a table"),
        ("!!python/object/apply:os.system ['true']", "is not YAML"),
        ("nodes: " + "[" * 5000, "too deep"),
        ("nodes: {}", "nodes = None: is missing"),
        ("nodes: {n: [0, 0, 0]}", "nodes = None: is missing"),
        ("", "nodes = None: is missing"),
    ],
)
def test_files_that_are_no_models(text, says, tmp_path):
    with pytest.raises(TensegrityError, match=says):
        tc.import_scene(written(tmp_path, it=text, star=STAR))


def test_many_structures_of_few_lines_are_bounded(tmp_path):
    names = [f"level{i}" for i in range(12)]
    texts = {name: f"substructures: {{a/b/c/d: {{path: {below}.yaml}}}}" for name, below in zip(names, [*names[1:], "star"])}
    with pytest.raises(InputError, match="makes more than 2000 structures"):
        tc.import_scene(written(tmp_path, **texts, star=STAR))


if __name__ == "__main__":
    failed = total = 0
    (folder,) = words(__doc__, str)
    for place in sorted(Path(folder).rglob("*.yaml")):
        try:
            message = "; ".join(note for note in tc.import_scene(place).notes if note.startswith("It cannot start"))
        except TensegrityError as failure:
            message = str(failure)
        total, failed = total + 1, failed + bool(message)
        print(place.name, message or "ok")
    print(f"{total - failed} of {total}")
