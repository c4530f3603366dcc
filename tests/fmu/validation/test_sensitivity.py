"""What start errors make of a run, of structures with joints."""

from __future__ import annotations

import numpy as np
import pytest

import tensegrity_core as tc
from fmu_src.validation.sensitivity import disturbed, idle_strings
from tensegrity_core import reference
from tensegrity_core.equilibria.jointed import movable
from tensegrity_core.model import grid, held
from tests.support.driven_scenes import built
from tests.support.jointed_scenes import SLIDER, random_joints


@pytest.mark.parametrize("seed", [0, 3, 6, 9])
def test_start_errors_keep_all_lengths(seed):
    """And what is fixed stays there."""
    model, size = random_joints(seed), 1e-9
    for other, _ in disturbed(model, held(model, grid(0.2, 0.02)), size):
        shift, rate = other.nodes - model.nodes, other.velocity - model.velocity
        assert np.abs(shift).max() == pytest.approx(size) and not shift[model.held].any()
        assert np.abs(other.bar_length - model.bar_length).max() <= 1e-15
        along = np.einsum("bd,bd->b", np.diff(model.nodes[model.bars], axis=1)[:, 0], np.diff(rate[model.bars], axis=1)[:, 0])
        assert np.abs(along).max() <= 1e-15


def test_strings_along_bars_are_idle_until_they_are_wound():
    model = tc.load("tests/structures/motes_double_pendulum.toml")
    still = held(model, grid(0.2, 0.02))
    assert idle_strings(reference.simulate(model, still), still, 1e-9) == {0, 1}
    wound = held(model, grid(0.2, 0.02), rest_length=lambda t: model.rest_length - [0.01 * t, 0.0])
    assert idle_strings(reference.simulate(model, wound), wound, 1e-9) == {1}


def test_nodes_can_be_moved_where_bars_let_them():
    model = built(SLIDER)  # n2 along z, n5 along x
    assert np.argwhere(movable(model)).tolist() == [[0, 2], [1, 0]]
    crank = tc.load("tests/structures/tsg_jansen_leg.toml")
    assert not movable(built(LEVER)).any() and movable(crank).shape == (0, 3)


#: A bar from a fixed node to a moved one.
LEVER = {
    "name": "lever",
    "start": "released",
    "fixed": ["n1", "n2"],
    "moving": ["n2.x"],
    "nodes": {"n1": [0, 0, 0], "n2": [1, 0, 0], "n3": [2, 0, 0.5]},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 1.0}, "b2": {"nodes": ["n2", "n3"], "mass": 1.0}},
    "strings": {},
}
