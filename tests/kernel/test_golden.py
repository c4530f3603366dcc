"""The kernel against trajectories of the reference that are kept in the repository: a change of the physics shows."""

import json
from pathlib import Path

import numpy as np
import pytest

from tensegrity_core import kernel
from tensegrity_core.scene import builtin_scenes
from tests.kernel.golden.write import inputs
from tests.support import scene

GOLDEN = Path(__file__).parent / "golden"


@pytest.mark.parametrize("method", ["auto", "rodas5p"])
@pytest.mark.parametrize("name", builtin_scenes())
def test_golden_trajectory(name, method):
    stored = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    model = scene(name)
    run = kernel.simulate(model, inputs(model), method=method, tolerance=1e-11)
    np.testing.assert_allclose(run.position[:, model.free_nodes], stored["position"], rtol=0, atol=1e-8)
    largest = np.abs(stored["string_force"]).max()
    np.testing.assert_allclose(run.string_force, stored["string_force"], rtol=0, atol=1e-3 + 1e-6 * largest)
    found = [[t.string, t.before, t.after] for t in run.transitions]
    assert found == [row[1:] for row in stored["transitions"]]
    for ours, row in zip(run.transitions, stored["transitions"]):
        assert abs(ours.time - row[0]) < 1e-7
