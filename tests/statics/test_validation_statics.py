"""Validation cases 1 and 2: structures whose self-stress is known in closed form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tensegrity_core.scene import Scene, parse_scene
from tensegrity_core.statics import (
    analyse,
    build_model,
    equilibrium_matrix,
    is_stable,
    member_forces,
    residual,
    tangent_stiffness,
)


def free_scene(nodes: dict, bars: list, strings: list, tension: dict) -> Scene:
    """A structure afloat, without gravity; one known tension."""
    return parse_scene(
        {
            "name": "afloat",
            "gravity": 0.0,
            "nodes": nodes,
            "materials": {"cable": {"stiffness": 1000.0}},
            "bars": {f"b{i}": {"nodes": list(ends), "mass": 1.0} for i, ends in enumerate(bars, 1)},
            "strings": {f"s{i}": {"nodes": list(ends), "material": "cable"} for i, ends in enumerate(strings, 1)},
            "prestress": {"tension": tension},
        }
    )


def three_bar_prism(radius: float = 0.4, height: float = 0.5) -> Scene:
    """Bars join bottom and top nodes 150 degrees apart, verticals those 30 degrees apart."""
    nodes = {}
    for i in range(3):
        for name, turn, z in (("low", 0.0, 0.0), ("top", 150.0, height)):
            angle = math.radians(120.0 * i + turn)
            nodes[f"{name}{i}"] = [radius * math.cos(angle), radius * math.sin(angle), z]
    bars = [(f"low{i}", f"top{i}") for i in range(3)]
    triangles = [(f"{level}{i}", f"{level}{(i + 1) % 3}") for level in ("low", "top") for i in range(3)]
    verticals = [(f"low{i}", f"top{(i - 1) % 3}") for i in range(3)]
    return free_scene(nodes, bars, triangles + verticals, {"s1": 10.0})


def expandable_octahedron(length: float = 1.5) -> Scene:
    """Six bars in three parallel pairs, half a bar length apart; cables join ends sqrt(3/8) bar lengths apart."""
    points, bars = {}, []
    for axis in range(3):
        for side in (-1, 1):
            ends = []
            for end in (-1, 1):
                point = [0.0, 0.0, 0.0]
                point[(axis + 1) % 3], point[axis] = side * length / 4, end * length / 2
                ends.append(f"n{len(points) + 1}")
                points[ends[-1]] = point
            bars.append(tuple(ends))
    cable = math.sqrt(3 / 8) * length
    pairs = itertools.combinations(points, 2)
    strings = [pair for pair in pairs if math.isclose(math.dist(points[pair[0]], points[pair[1]]), cable)]
    assert len(strings) == 24
    return free_scene(points, bars, strings, {"s1": 10.0})


def densities(model, force):
    """Forces over lengths of strings, then bars."""
    ends = np.vstack([model.strings, model.bars])
    return force / np.linalg.norm(model.nodes[ends[:, 1]] - model.nodes[ends[:, 0]], axis=1)


def self_stressed(scene, equations, members):
    """Force densities of the self-stress of a free structure that has one, and one mechanism."""
    model = build_model(scene)
    found = analyse(model)
    assert (found.equations, found.members, found.rank) == (equations, members, members - 1)
    assert found.self_stress.shape == (members, 1)
    assert len(found.mechanisms) == 1
    assert found.rigid_body_motions == 6
    return densities(model, found.self_stress[:, 0])


@pytest.mark.parametrize("radius, height", [(0.4, 0.5), (1.0, 3.0)])
def test_three_bar_prism(radius, height):
    q = self_stressed(three_bar_prism(radius, height), 18, 12)
    q = q / -q[-1]  # bar = -1
    np.testing.assert_allclose(q[:6], 1 / math.sqrt(3), rtol=1e-12)
    np.testing.assert_allclose(q[6:9], 1.0, rtol=1e-12)
    np.testing.assert_allclose(q[9:], -1.0, rtol=1e-12)


def test_three_bar_prism_twist_other_than_150_degrees_has_no_self_stress():
    scene = three_bar_prism()
    nodes = {name: list(point) for name, point in scene.nodes.items()}
    for i in range(3):
        angle = math.radians(120.0 * i + 149.0)
        nodes[f"top{i}"] = [0.4 * math.cos(angle), 0.4 * math.sin(angle), 0.5]
    bars = [bar.nodes for bar in scene.bars.values()]
    strings = [string.nodes for string in scene.strings.values()]
    tension = {f"s{i}": 1.0 for i in range(1, 10)}
    moved = parse_scene(free_scene(nodes, bars, strings, tension).model_dump() | {"start": "released"})
    assert analyse(build_model(moved)).rank == 12


def test_expandable_octahedron():
    q = self_stressed(expandable_octahedron(), 36, 30)
    np.testing.assert_allclose(q[24:] / q[0], -1.5, rtol=1e-12)
    np.testing.assert_allclose(q[:24] / q[0], 1.0, rtol=1e-12)


@pytest.mark.parametrize("make", [three_bar_prism, expandable_octahedron])
def test_self_stress_and_mechanism_satisfy_their_definitions(make):
    model = build_model(make())
    found = analyse(model)
    matrix = equilibrium_matrix(model)
    assert np.abs(matrix @ found.self_stress).max() < 1e-14
    field = found.mechanisms[0]
    assert np.abs(matrix.T @ field[model.free_nodes].ravel()).max() < 1e-14
    assert np.linalg.norm(field) == pytest.approx(1.0, rel=1e-12)
    # no rigid-body part: neither net translation nor net rotation about the centre
    assert np.abs(field.sum(axis=0)).max() < 1e-13
    assert np.abs(np.cross(model.nodes - model.nodes.mean(axis=0), field).sum(axis=0)).max() < 1e-13


@pytest.mark.parametrize("make", [three_bar_prism, expandable_octahedron])
def test_prestress_scales_the_self_stress(make):
    model = build_model(make())
    force, shape = member_forces(model), analyse(model).self_stress[:, 0]
    assert force[0] == pytest.approx(10.0, rel=1e-12)
    np.testing.assert_allclose(force, 10.0 * shape / shape[0], rtol=1e-11)
    assert np.abs(residual(model)).max() <= 1e-10


@pytest.mark.parametrize("make", [three_bar_prism, expandable_octahedron])
def test_prestress_stiffens_the_mechanism(make):
    """Beside the six rigid-body motions every direction, the mechanism's too, is stiff; and the stiffer the more
    prestress there is."""
    scene = make()
    softest = []
    for level in (10.0, 20.0):
        prestress = scene.prestress.model_copy(update={"tension": {"s1": level}})
        stiffness = tangent_stiffness(build_model(scene.model_copy(update={"prestress": prestress})))
        assert is_stable(stiffness)
        assert np.abs(stiffness[:6]).max() < 1e-9
        softest.append(stiffness[6])
    assert softest[1] > 1.5 * softest[0] > 1.0
