"""FMUs of structures with joints: bars that share nodes, welded ones, ones without mass, nodes fixed and moved along single
axes; of both runtimes and versions, for co-simulation and model exchange, against the reference.

`python -m tests.fmu.runtimes.test_joints_fmu 40` does the same for so many random structures.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import zipfile
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

import tensegrity_core as tc
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation import validate
from fmu_src.validation.scenarios import Scenario
from fmu_src.variables.interface import variables
from tensegrity_core import kernel
from tensegrity_core.errors import TensegrityError
from tensegrity_core.model import grid, held
from tests.support.driven_scenes import built
from tests.support.jointed_scenes import SLIDER, random_joints
from tests.support.native_calls import DISCARD, MODEL_EXCHANGE, OK, Calls
from tests.support.words import words

#: A braced panel in the plane, hung up by strings: its six bars hold each other, and one has no mass.
PANEL = {
    "name": "panel",
    "plane": "xz",
    "start": "released",
    "fixed": ["n5", "n6"],
    "nodes": {"n1": [0, 0], "n2": [1, 0], "n3": [1.1, 0.9], "n4": [0, 1], "n5": [-0.5, 1.8], "n6": [1.6, 1.9]},
    "bars": {
        f"b{i}": {"nodes": [f"n{a}", f"n{b}"], "mass": 0.0 if i == 1 else 0.5 + 0.1 * i}
        for i, (a, b) in enumerate([(1, 2), (2, 3), (3, 4), (4, 1), (1, 3), (2, 4)], 1)
    },
    "strings": {
        "s1": {"nodes": ["n5", "n4"], "stiffness": 300.0, "damping": 5.0},
        "s2": {"nodes": ["n6", "n3"], "stiffness": 400.0, "damping": 5.0},
    },
    "prestress": {"rest_length": {"s1": 0.8, "s2": 1.0}},
}
SEEDS = (3, 6, 9)
MODELS = {"slider": built(SLIDER), "panel": built(PANEL)} | {f"random_{seed}": random_joints(seed) for seed in SEEDS}
#: What an FMU may be: packed by, kind, version, what runs it.
MADE = {
    "python": (pack_python_fmu, {}, "cs", "2.0"),
    "native": (pack_native_fmu, {"kind": "cs"}, "cs", "2.0"),
    "me": (pack_native_fmu, {"kind": "me"}, "me", "2.0"),
    "native, FMI 3.0": (pack_native_fmu, {"standard": "3.0"}, "cs", "3.0"),
    "me, FMI 3.0": (pack_native_fmu, {"kind": "me", "standard": "3.0"}, "me", "3.0"),
}


def test_the_structures_have_all_that_is_meant():
    models = list(MODELS.values())
    assert all(model.joint for model in models)
    assert any(model.redundant.any() for model in models) and any((model.bar_mass == 0.0).any() for model in models)
    assert any(model.welds for model in models) and any(model.partly_fixed for model in models)
    assert any(model.moving_axes for model in models)


def driven(model, duration=0.2) -> Scenario:
    """Forces along free axes that turn round, rest lengths and moved nodes that move."""
    random = np.random.default_rng(5)
    force = random.normal(scale=5.0, size=model.nodes.shape) * ~model.held
    force[:, [axis for axis in range(3) if axis not in model.axes]] = 0.0
    rest, home = random.uniform(-0.1, 0.1, len(model.strings)), model.nodes[list(model.moving)]
    inputs = held(
        model,
        grid(duration, 0.01),
        force=lambda t: force if t < 0.5 * duration else -force,
        rest_length=lambda t: model.rest_length + rest * t,
        motion=(lambda t: (home + 0.1 * t * t, np.full(home.shape, 0.2 * t))) if len(home) else None,
    )
    return Scenario("driven", "everything moves", model, inputs, "driven", method="DOP853")


class Here:
    """An executor that runs everything at once in this process."""

    def submit(self, function, *arguments, **options):
        future = Future()
        future.set_result(function(*arguments, **options))
        return future


def failures(model, folder, made) -> list[str]:
    """What a kind of FMU of a model gets wrong."""
    pack, contents, kind, version = MADE[made]
    fmu = pack(model, Path(folder) / f"{made}.fmu", **contents)
    runs = [driven(model)]
    done = validate.run_outside(fmu, model, runs=validate.repeated(runs) if kind == "cs" else runs, kind=kind, fmi=version)
    references = validate.submit(Here(), runs, None)
    return validate.finish(model, made, runs, done, references, Here(), None).failures


@pytest.mark.parametrize("made", MADE)
@pytest.mark.parametrize("name", ["slider", "panel", "random_6"])
def test_fmus_follow_the_reference(name, made, tmp_path):
    assert failures(MODELS[name], tmp_path, made) == []


@pytest.mark.parametrize("name", MODELS)
def test_both_runtimes_give_the_same(name, both, tmp_path):
    """What the kernel gives here; after a roll-back again."""
    model, run = MODELS[name], driven(MODELS[name])
    fmu = both.pack(model, tmp_path / "one.fmu")
    expected = kernel.simulate(model, run.inputs)
    ((found, events, _),) = validate.run_outside(fmu, model, runs=[run])
    for field in ("position", "velocity", "bar_force", "reaction", "kinetic", "input_work"):
        right = getattr(expected, field)
        np.testing.assert_allclose(found[field], right, rtol=1e-11, atol=1e-11 * max(1.0, np.abs(right).max()), err_msg=field)
    assert events == expected.transitions


@pytest.mark.parametrize("made", ["python", "native, FMI 3.0"])
@pytest.mark.parametrize("name", ["motes_double_pendulum", "stedy_dbar", "tsg_jansen_leg"])
def test_published_structures_follow_the_reference(name, made, tmp_path):
    assert failures(tc.load(f"tests/structures/{name}.toml"), tmp_path, made) == []


def unpacked(fmu, folder):
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


def test_variables_are_those_that_a_structure_has(both, tmp_path):
    model = MODELS["slider"]
    one = both(unpacked(both.pack(model, tmp_path / "slider.fmu"), tmp_path / "slider"), "stepping")
    known = {v.name: v for v in one.description.modelVariables}
    assert {"n2.force.x", "n2.reaction.y", "n2.reaction.z", "n2.position.z", "n2.velocity.x"} <= set(known)
    assert known["n5.position.x"].causality == "input" and known["n5.x"].causality == "output"
    assert not {"n2.force.y", "n2.reaction.x", "n2.position.x", "n5.position.y", "n5.force.x"} & set(known)
    assert one.set({"n2.position.z": 0.1, "n2.velocity.z": 0.3, "n2.acceleration.z": 0.0}) == OK
    one.walk(1)
    height, across = one.get("n2.z", "n2.y")
    assert abs(height - 0.103) < 1e-15 and across == 0.0


def test_redundant_bars_and_bars_without_mass_say_so():
    model = next(model for model in MODELS.values() if model.redundant.any() and (model.bar_mass == 0.0).any())
    rows = {row.name: row for row in variables(model)}
    for name, redundant, mass in zip(model.bar_names, model.redundant, model.bar_mass):
        assert ("least norm" in rows[f"{name}.force"].description) == redundant
        assert (f"{name}.mass" in rows) == (mass > 0.0)
    bare = random_joints(0)  # nodes that have nothing but their point masses
    least = {node: row.min for row in variables(bare) for node in bare.node_names if row.name == f"{node}.mass"}
    massive = {bare.node_names[node] for ends, mass in zip(bare.bars, bare.bar_mass) if mass for node in ends}
    on_bars = {bare.node_names[node] for node in bare.bars.ravel()}
    assert any(low > 0.0 for low in least.values())
    assert all((low > 0.0) == (node in on_bars - massive) for node, low in least.items())


def test_partial_derivatives_are_neither_declared_nor_given(tmp_path):
    model = MODELS["slider"]
    fmu = pack_native_fmu(model, tmp_path / "me.fmu", kind="me")
    assert not read_model_description(str(fmu)).modelExchange.providesDirectionalDerivative
    one = Calls(unpacked(fmu, tmp_path / "me"), kind=MODEL_EXCHANGE)
    one.bring_to("initialization")
    output, force = one.references(["n3.x"]), one.references(["n3.force.x"])
    values = (ctypes.c_double * 1)(1.0), (ctypes.c_double * 1)()
    assert one.do("GetDirectionalDerivative", output, 1, force, 1, *values) == DISCARD and one.said("joined")
    assert one.set({"n3.force.x": 1.0}) == OK  # and nothing has changed
    one.free()
    newer = read_model_description(str(pack_native_fmu(model, tmp_path / "3.fmu", kind="both", standard="3.0")))
    assert not newer.modelExchange.providesDirectionalDerivative and not newer.coSimulation.providesAdjointDerivatives


if __name__ == "__main__":
    wrong = refused = 0
    (count,) = words(__doc__, int)
    for seed in range(count):
        model = random_joints(seed)
        if not model.joint:
            continue
        for made in MADE:
            with tempfile.TemporaryDirectory() as folder:
                try:
                    found = failures(model, folder, made)
                except TensegrityError as failure:
                    found, refused = [], refused + 1
                    print(seed, made, "refused:", failure)
            wrong += bool(found)
            for failure in found:
                print(seed, made, failure)
    print(f"{wrong} FMUs are wrong, {refused} runs refused")
    sys.exit(bool(wrong))
