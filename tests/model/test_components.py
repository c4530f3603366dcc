"""Which values of a vector are variables where nodes are fixed or moved along single axes."""

from __future__ import annotations

import numpy as np

import tensegrity_core as tc
from tensegrity_core.fields import FIELDS, outputs
from tensegrity_core.model.components import flattened, named, names, present, spread
from tensegrity_core.model.signals import places
from tests.support.driven_scenes import built

SCENE = {
    "name": "rail",
    "start": "released",
    "fixed": ["n1", "n2.y", "n2.z", "n4"],
    "moving": ["n2.y", "n4.z"],
    "nodes": {"n1": [0, 0, 1], "n2": [1, 0, 0], "n3": [2, 0, 1], "n4": [3, 0, 0]},
    "point_masses": {"n2": 0.5, "n3": 0.1},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 0.0}, "b2": {"nodes": ["n2", "n3"], "mass": 1.0}},
    "strings": {"s1": {"nodes": ["n3", "n4"], "stiffness": 10.0}},
    "prestress": {"rest_length": {"s1": 1.2}},
}


def field(name):
    return next(row for row in FIELDS if row.name == name)


def test_a_node_has_forces_along_its_free_axes_reactions_along_the_others_and_motion_where_it_is_moved():
    model = built(SCENE)
    assert list(named(field("force"), model)) == ["n2.force.x", *(f"n3.force.{axis}" for axis in "xyz")]
    assert list(named(field("velocity"), model)) == ["n2.velocity.x", *(f"n3.velocity.{axis}" for axis in "xyz")]
    grounded = [f"{node}.reaction.{axis}" for node, axes in (("n1", "xyz"), ("n2", "yz"), ("n4", "xyz")) for axis in axes]
    assert list(named(field("reaction"), model)) == grounded
    assert list(named(field("node_position"), model)) == ["n2.position.y", "n4.position.z"]
    assert list(named(field("bar_mass"), model)) == ["b2.mass"]  # what has none has none to change
    assert len(named(field("position"), model)) == 12
    known = places(model)
    assert "n2.force.y" not in known and "n4.velocity.x" not in known
    assert known["n2.velocity.y"] == ("node_velocity", 1) and names(field("node_velocity"), model)[1] == "n2.velocity.y"


def test_scenes_without_single_axes_have_all_of_them():
    for name in ("three_bar_nsh", "two_bar"):
        model = tc.load(name)
        for row in FIELDS:
            assert list(named(row, model)) == names(row, model)


def test_flat_values_and_those_of_a_result_are_the_same():
    """But for those that are no variables, which are zero in a result."""
    model = built(SCENE)
    random = np.random.default_rng(1)
    for row in outputs():
        flat = random.normal(size=(2, len(names(row, model))))
        has = present(row, model)
        assert np.array_equal(flattened(row, model, spread(row, model, flat)), np.where(has, flat, 0.0)), row.name


def test_files_of_a_run_have_the_same_names_and_come_back(tmp_path):
    model = built(SCENE)
    from tensegrity_core import reference
    from tensegrity_core.model import grid
    from tensegrity_core.model.signals import driven
    from tensegrity_core.output.export import columns, write_result
    from tensegrity_core.output.page.series import result_of_file

    signals = {"n2.position.y": lambda t: 0.1 * t * t, "n2.velocity.y": lambda t: 0.2 * t, "n3.force.x": 1.0}
    result = reference.simulate(model, driven(model, grid(0.1, 0.05), signals), rtol=1e-8, atol=1e-9)
    assert np.allclose(result.position[:, 1, 1], 0.1 * result.times**2) and result.position[-1, 1, 0] != 1.0
    found = columns(model, result)
    assert "n2.reaction.z" in found and "n2.reaction.x" not in found and "n2.velocity.y" not in found
    write_result(model, result, tmp_path / "run.csv")
    again = result_of_file(tmp_path / "run.csv", model)
    for row in outputs():
        assert np.allclose(again.outputs[row.name], result.outputs[row.name], rtol=1e-12, atol=0.0), row.name
