"""What members bear, and how much of it they use: closed forms, kernel against reference, FMUs, what is printed."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi

import numpy as np
import pytest

import tensegrity_core as tc
from fmu_src.variables.interface import variables
from tensegrity_core import kernel, reference
from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError, TensegrityError
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.kernel.packing import fnv1a
from tensegrity_core.model import grid, held
from tensegrity_core.model.signals import driven
from tensegrity_core.model.strength import Section
from tensegrity_core.scene import builtin_scenes
from tests.reference.test_structures import FOLDER
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, RATED, built

TUBE = {"E": 210e9, "diameter": 0.02, "wall": 0.001}


@pytest.mark.parametrize(
    "keys, moment, area",
    [
        ({"diameter": 0.012}, pi / 64.0 * 0.012**4, pi / 4.0 * 0.012**2),
        ({"diameter": 0.02, "wall": 0.001}, pi / 64.0 * (0.02**4 - 0.018**4), pi / 4.0 * (0.02**2 - 0.018**2)),
        ({"area": 1.2e-4, "second_moment": 4e-10}, 4e-10, 1.2e-4),
    ],
)
def test_a_pushed_bar_uses_its_force_over_eulers_load(keys, moment, area):
    """A mast of 1 m between guys: its force is in the outputs, its buckling load pi^2 E I/l^2."""
    model = tc.load("three_bar", {f"bars.b1.{key}": value for key, value in (keys | {"E": 70e9}).items()})
    ((bar, section),) = model.sections
    assert bar == 0 and section.bending_stiffness == pytest.approx(70e9 * moment, rel=1e-14)
    assert section.gyration == pytest.approx(np.sqrt(moment / area), rel=1e-14)
    run = tc.simulate(model, {"n4.force.z": ([0.0, 0.5, 0.5], [-300.0, -300.0, 300.0])}, 1.0)
    force, used = run["b1.force"].values, run["b1.utilisation"].values
    assert force.min() < -100.0 and force.max() > 10.0
    np.testing.assert_allclose(used, np.maximum(-force, 0.0) * model.bar_length[0] ** 2 / (pi**2 * 70e9 * moment), rtol=1e-14)
    assert (used[force > 0.0] == 0.0).all() and "b2.utilisation" not in run.data
    assert run["b1.utilisation"].attrs["units"] == "1"


def test_a_pulled_string_uses_its_tension_over_its_strength():
    """Its own strength comes before that of its material; a damper that pushes uses nothing."""
    model = tc.load("three_bar", {"strings.s1.strength": 40.0, "materials.cable.strength": 500.0})
    assert dict(model.strength) == {0: 40.0} | dict.fromkeys(range(1, 6), 500.0)
    run = tc.simulate(model, {"n4.force.z": ([0.0, 0.2, 0.2], [-300.0, -300.0, 300.0])}, 1.0)
    for name, strength in zip(model.string_names, (40.0, *[500.0] * 5)):
        tension = run[f"{name}.force"].values
        np.testing.assert_array_equal(run[f"{name}.utilisation"].values, np.maximum(tension, 0.0) / strength)
    assert any((run[f"{name}.force"].values < 0.0).any() for name in model.string_names), "or no damper pushed"


def test_the_kernel_finds_what_the_reference_finds():
    model = built(RATED)
    inputs = driven(model, grid(0.5, 0.01), {"n4.force.z": -200.0})
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    for name in ("bar_utilisation", "string_utilisation"):
        assert ours.outputs[name].max(axis=0).min() > 1e-3, "every member is loaded"
        assert np.abs(ours.outputs[name] - theirs.outputs[name]).max() < 1e-6


def test_it_is_the_same_motion_to_the_last_bit():
    """What is known of the members changes nothing but that."""
    plain, rated = built(LABORATORY), built(RATED)
    runs = [kernel.simulate(model, held(model, grid(0.3, 0.01))) for model in (plain, rated)]
    for name, values in runs[0].outputs.items():
        if not name.endswith("utilisation"):
            np.testing.assert_array_equal(values, runs[1].outputs[name])
    assert runs[0].bar_utilisation.shape == (31, 0) and runs[1].bar_utilisation.shape == (31, 3)


def test_scenes_that_do_not_say_it_have_nothing_of_it():
    for name in builtin_scenes():
        model = scene(name)
        assert not (model.sections or model.strength)
        assert not [
            row.name for row in variables(model) if row.name.endswith(("utilisation", ".strength", "bending_stiffness"))
        ]
    rows = {row.name: row for row in variables(built(RATED))}
    known = {name: (row.causality, row.unit) for name, row in rows.items() if row.name.startswith(("b", "s7", "s1."))}
    assert known["b1.utilisation"] == ("output", "1") and known["s7.utilisation"] == ("output", "1")
    assert known["b2.bending_stiffness"] == ("parameter", "N.m2") and known["s1.strength"] == ("parameter", "N")
    assert "b3.utilisation" not in rows and "s8.utilisation" not in rows


def test_parameters_of_an_fmu_count_in_what_it_puts_out():
    model = built(RATED)
    block = Kernel(model)
    block.initialize()
    before = block["bar_utilisation"].copy(), block["string_utilisation"].copy()
    block.reset()
    block["bending_stiffness"][:] *= 4.0
    block["strength"][:] *= 0.5
    block.initialize()
    np.testing.assert_allclose(block["bar_utilisation"], before[0] / 4.0, rtol=1e-14)
    np.testing.assert_allclose(block["string_utilisation"], before[1] * 2.0, rtol=1e-14)


def test_damaged_models_are_refused():
    model = built(RATED)
    packed = to_bytes(model)
    places = np.frombuffer(packed, "<i4", len(packed) // 4, 0)
    wanted = [0, 1, 3, 0, 1, 2, 3, 4, 5, 6]  # bars with a section, strings with a strength
    (at,) = (i for i in range(len(places) - len(wanted)) if places[i : i + len(wanted)].tolist() == wanted)
    for place, says in ((at, "a section is of an unknown bar"), (at + 3, "a strength is of an unknown string")):
        bad = bytearray(packed[:-8])
        bad[4 * place : 4 * place + 4] = (77).to_bytes(4, "little")
        with pytest.raises(TensegrityError, match=says):
            Kernel(bytes(bad) + fnv1a(bytes(bad)).to_bytes(8, "little"))


def test_check_and_simulate_tell_it(tmp_path, capsys):
    path = tmp_path / "columns.toml"
    path.write_text('extends = "three_bar"\nname = "columns"\n[bars]\nb1 = { E = 70e9, diameter = 0.012 }\n', encoding="utf-8")
    path.write_text(path.read_text(encoding="utf-8") + "[strings]\ns4 = { strength = 5.0 }\n", encoding="utf-8")
    assert main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    load = pi**2 * 70e9 * pi / 64.0 * 0.012**4 / tc.load(path).bar_length[0] ** 2
    assert "utilisation; 1 bear less than they have to:\n    s4: 156.3 % of its strength 5 N\n" in told
    assert f"of its buckling load {load:.6g} N, slenderness {tc.load(path).bar_length[0] / 0.003:.4g}" in told
    assert main(["check", str(path), "--json"]) == 0
    used = json.loads(capsys.readouterr().out)["utilisation"]
    assert list(used) == ["s4", "b1"] and used["b1"] == pytest.approx(15.5185 / load, rel=1e-4)
    assert main(["simulate", str(path), "--duration", "0.1", "--force", "n4.z=-40"]) == 0
    assert "largest utilisation:\n    s4: " in capsys.readouterr().out
    assert main(["check", "three_bar"]) == 0 and "utilisation" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "keys, key, says",
    [
        ({"E": 1e9}, "E", "without a section"),
        ({"diameter": 0.01}, "E", "is missing in a bar with a round section"),
        ({"E": 1e9, "area": 1e-4}, "second_moment", "is missing"),
        ({"E": 1e9, "second_moment": 1e-9}, "area", "is missing"),
        ({"E": 1e9, "wall": 1e-3}, "diameter", "is missing"),
        ({"E": 1e9, "diameter": 0.01, "area": 1e-4}, "area", "does not belong to a bar with a round section"),
        ({"E": 1e9, "diameter": 0.01, "wall": 0.005}, "wall", "leaves no hole in a tube of the diameter 0.01"),
        ({"E": -1.0, "diameter": 0.01}, "E", "is not greater than 0"),
        ({"E": float("nan"), "diameter": 0.01}, "E", "not a finite number"),
    ],
)
def test_contradictions_are_named(keys, key, says):
    with pytest.raises(SceneError, match=says) as found:
        tc.load("three_bar", {f"bars.b1.{name}": value for name, value in keys.items()})
    assert found.value.key == f"bars.b1.{key}"


def test_bars_that_meet_have_it_too():
    """A D-bar, whose bars share nodes: kernel, reference, and the variables of an FMU."""
    model = tc.load(FOLDER / "stedy_dbar.toml")
    sections = tuple((bar, Section(10.0, 0.01)) for bar in range(len(model.bars)))
    model = replace(model, sections=sections, strength=tuple((string, 30.0) for string in range(len(model.strings))))
    inputs = held(model, grid(0.5, 0.05))
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    assert ours.bar_utilisation.max(axis=0).min() > 0.1 and ours.string_utilisation.max() > 1.0
    for name in ("bar_utilisation", "string_utilisation"):
        assert np.abs(ours.outputs[name] - theirs.outputs[name]).max() < 1e-7
    rows = {row.name: row for row in variables(model)}
    assert set(rows["b1.force"].known) | {rows["b1.bending_stiffness"].reference} == set(rows["b1.utilisation"].known)
    assert [one.value for one in tc.linearize(model).outputs if one.name == "s1.utilisation"] == [0.0]
