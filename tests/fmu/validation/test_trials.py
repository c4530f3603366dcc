"""The runs under which FMUs are judged: what they excite, what they cost, and that nothing wrong by 1e-5 gets through."""

from dataclasses import replace

import numpy as np
import pytest

from fmu_src.validation.compare import compare
from fmu_src.validation.trials import AFFORDABLE, DURATION, trials
from fmu_src.validation.validate import SETTINGS
from tensegrity_core import kernel, reference
from tensegrity_core.scene import builtin_scenes
from tests.fmu.validation.mutations import (
    SCENES,
    SOURCES,
    as_fmu,
    caught,
    compiled,
    missed,
    mutated_library,
    prepared,
    with_library,
)
from tests.kernel.test_random_scenes import random_model


@pytest.fixture(scope="module")
def ready():
    """Trials of a scene, made once."""
    made = {}

    def prepare(name):
        if name not in made:
            made[name] = prepared(SCENES[name]())
        return made[name]

    return prepare


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar_nsh"])
def test_trials_reach_every_piece_of_every_law(name, ready):
    visited = {(t.string, piece) for one in ready(name) for t in one.right.transitions for piece in (t.before, t.after)}
    simulation = kernel.Kernel(SCENES[name]())
    assert visited == {(j, p) for j in range(simulation.counts["S"]) for p in range(len(simulation.pieces(j)))}


def test_trials_move_every_input(ready):
    inputs = ready("laboratory")[0].run.inputs
    model = SCENES["laboratory"]()
    unwound = [j for j in range(len(model.strings)) if j not in model.actuated]
    assert np.ptp(inputs.force[:, model.free_nodes], axis=0).min() > 0.0
    assert np.ptp(inputs.rest_length[:, unwound], axis=0).min() > 0.0 and inputs.rest_length.min() >= 0.0
    for name in ("current", "drum_load", "node_position", "node_velocity"):
        assert np.ptp(getattr(inputs, name), axis=0).min() > 0.0, name


@pytest.mark.parametrize("seed", range(2))
def test_trials_are_as_long_as_they_are_affordable(seed):
    """Light bars and strong springs make a motion fast; the runs become short, not dear."""
    model = random_model(seed)
    for fast in (1.0, 1e-3):
        runs = trials(replace(model, bar_mass=fast * model.bar_mass))
        again = trials(replace(model, bar_mass=fast * model.bar_mass))
        for run, same in zip(runs, again, strict=True):
            spent = kernel.simulate(run.model, run.inputs, method="dop853", tolerance=1e-11).stats["rhs"]
            assert spent <= AFFORDABLE and run.inputs.times[-1] <= DURATION
            np.testing.assert_array_equal(run.inputs.rest_length, same.inputs.rest_length)


#: Every so many of a scene's parameters are tried here; all of them by `python -m tests.fmu.validation.mutations`.
EVERY = {name: 6 if name in builtin_scenes() else 9 for name in SCENES} | {"six_bar": 20, "six_bar_nsh": 60, "laboratory": 11}
EVERY |= dict.fromkeys(("mast_memory", "mast_bistable", "mast_cells", "mast_mixed"), 15)


@pytest.mark.parametrize("name", SCENES)
def test_a_parameter_that_is_wrong_by_1e_5_is_caught(name, ready):
    every = EVERY[name]
    count, found = missed(SCENES[name](), ready(name), lambda i: i % every == 0)
    assert count >= 2 and found == []


@pytest.mark.parametrize("name", ["two_bar", "mast_snap", "mast_memory"])
def test_the_kernel_stands_in_for_the_reference(name, ready):
    """It passes with a part of the bounds only: what is judged by it would pass with the reference, too."""
    for one in ready(name)[1:2]:
        right = reference.simulate(one.run.model, one.run.inputs, **SETTINGS)
        found = compare(right, as_fmu(one.right), one.right.transitions, one.allowed, float(one.run.model.bar_length.max()))
        assert found.failures == [] and found.part < 0.5


#: Compiled here; all of them by `python -m tests.fmu.validation.mutations`.
COMPILED = ("inertia of a pinned bar", "bar force", "weight of the method")


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("sources") / "right")


@pytest.mark.parametrize("name", COMPILED)
def test_a_source_that_is_wrong_by_1e_5_is_caught(name, ready, sources, tmp_path):
    trials_of_it = ready(SOURCES[name]["scene"])
    assert caught(trials_of_it, with_library(mutated_library(tmp_path / "wrong", name, sources))) is not None
    assert caught(trials_of_it[:1], with_library(mutated_library(tmp_path / "right", None, sources))) is None
