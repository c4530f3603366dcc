"""Steady heights of the three-bar structure: waited for by the dynamics, solved by the statics."""

import numpy as np
import pytest

from tensegrity_core import kernel, statics
from tensegrity_core.model import grid, held
from tests.support import push, scene

LOADS = (12.0, 26.0, 42.0, 54.0)  # N on each top node: before, between and after the snaps


@pytest.mark.parametrize("name, snapped", [("three_bar", []), ("three_bar_nsh", [0, 2, 3, 4])])
def test_statics_finds_the_height_that_the_dynamics_reaches(name, snapped):
    model = scene(name)
    solved, before, heights = model, None, []
    for n, load in enumerate(LOADS):
        force = push(model, load, 0.0)
        solved = statics.settle(solved, force=force, force_before=before, steps=20)
        before = force
        run = kernel.simulate(model, held(model, grid(50.0, 10.0), force=lambda t, force=force: force))
        assert np.abs(run.velocity[-1]).max() < 1e-9, "not at rest yet"
        np.testing.assert_allclose(run.position[-1, 3:, 2], solved.nodes[3:, 2], rtol=0, atol=1e-6)
        if snapped:
            assert (run.snapped[-1] == snapped[n]).all()
        heights.append(run.position[-1, 3:, 2].mean())
    assert (np.diff(heights) > 1e-4).all()
    if snapped:  # more compliant than without honeycombs
        assert heights[-1] - heights[0] > 0.05
