"""Outputs of the native FMU are computed when somebody reads them; who reads late, or in parts, gets the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import simulate_fmu

from fmu_src.packing.native_fmu import pack_native_fmu
from tests.support import changed, scene
from tests.support.native_calls import OK, Calls

H, STEPS = 0.002, 60


def started(folder) -> Calls:
    one = Calls(folder)
    assert one.start() == OK
    return one


def inputs(one: Calls, step: int) -> dict[str, float]:
    """Forces that jump at some steps, rest lengths that move after a while."""
    random = np.random.default_rng(step // 7)
    names = one.names("input")
    forces = {name: 20.0 * random.normal() for name in names if ".force." in name}
    return forces | {name: 0.01 * random.normal() * (step > 40) for name in names if name.endswith("rest_length_rate")}


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar"])
def test_who_reads_late_and_in_parts_gets_the_same_bits(name, native_folders):
    """Also after inputs have been set for the next step, from a saved state, and beside derivatives of outputs."""
    plain, late = started(native_folders[name]), started(native_folders[name])
    names, random = plain.names("output"), np.random.default_rng(3)
    for step in range(STEPS):
        assert plain.step(step * H, H) == late.step(step * H, H) == OK
        found = dict(zip(names, plain.get(*names), strict=True))
        for one in (plain, late):
            assert one.set(inputs(one, step)) == OK
        for output in random.permutation(names)[: random.choice([0, 0, 1, 3, len(names)])]:
            assert late.get(output) == found[output], output
        if step % 9 == 4:
            assert late.restore(late.serialised()) == OK
            np.testing.assert_array_equal(late.output_derivatives(names)[1], plain.output_derivatives(names)[1])
    assert late.get(*names) == plain.get(*names)


@pytest.mark.parametrize("event_mode", [False, True])
@pytest.mark.parametrize("name", ["two_bar", "six_bar_nsh"])
def test_fmpy_goes_on_after_steps_that_ended_early(name, event_mode, tmp_path):
    """What it reads at common points in time is what it reads without early ends; six_bar_nsh has hundreds of transitions."""
    fmu = str(pack_native_fmu(changed(scene(name), damping=50.0), tmp_path / "one.fmu", standard="3.0"))
    axes = 2 if name == "two_bar" else 3
    push = np.array([0.0] * (axes - 1) + [-250.0])
    rows = [(0.0, 0.0 * push), (0.1, 0.0 * push), (0.1, push), (0.6, push), (0.6, 0.0 * push), (1.0, 0.0 * push)]
    given = np.array(rows, dtype=[("time", float), ("n4.force", float, (axes,))])
    runs = []
    for early in (False, True):
        run = {"stop_time": 1.0, "output_interval": 0.01, "input": given, "output": ["n4.position", "energy.kinetic"]}
        runs.append(simulate_fmu(fmu, **run, early_return_allowed=early, use_event_mode=event_mode))
    assert len(runs[1]) > len(runs[0]) + (100 if name == "six_bar_nsh" else 2)
    for k in range(101):
        ends = [run[np.flatnonzero(np.isclose(run["time"], 0.01 * k, rtol=1e-9, atol=1e-12))[-1]] for run in runs]
        for output in ("n4.position", "energy.kinetic"):
            np.testing.assert_allclose(ends[1][output], ends[0][output], rtol=1e-9, atol=1e-10)
