"""Strings of any element: their scene keys and mistakes in them, their statics, their motion in the reference."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from tensegrity_core import reference, statics
from tensegrity_core.errors import InputError, SceneError
from tensegrity_core.laws import hysteresis
from tensegrity_core.model import NSH, grid, held
from tensegrity_core.model.elements import Beam, Parallel, Polynomial, Series, Spring, Table
from tensegrity_core.scene import parse_scene, scene_schema
from tests.reference.test_reference import push_x, slider
from tests.scene.test_scene import GOOD

EXTRA = """
[elements.soft_spring]
kind = "spring"
stiffness = 3000.0

[elements.arch]
kind = "beam"
Q = 9.0
zeta = 5.0
h = 0.01

[elements.rubber]
kind = "polynomial"
coefficients = [2000.0, 0.0, 1.0e6]

[elements.measured]
kind = "table"
elongation = [0.0, 0.01, 0.02, 0.03]
force = [0.0, 8.0, 12.0, 30.0]
interpolation = "cubic"

[elements.braced]
kind = "parallel"
parts = ["arch", "soft_spring"]

[elements.stack]
kind = "series"
parts = ["braced", "braced", "rubber", "measured"]

[elements.snapping]
kind = "series"
parts = ["arch", "arch", "soft_spring"]
law = "hysteretic"

[dampers.cubic]
coefficients = [40.0, 0.0, 5.0]

[dampers.valve]
rate = [0.0, 0.1, 1.0]
force = [0.0, 20.0, 30.0]
"""
WHOLE = GOOD.replace('"cable", nsh = "soft" }', '"cable", element = "stack", damper = "cubic" }') + EXTRA


def test_a_scene_with_every_kind_of_element():
    raw = tomllib.loads(WHOLE)
    model = statics.build_model(parse_scene(raw))
    arch, spring = Beam(9.0, 5.0, 0.01), Spring(3000.0)
    braced, rubber = Parallel((arch, spring)), Polynomial((2000.0, 0.0, 1e6))
    table = Table((0.0, 0.01, 0.02, 0.03), (0.0, 8.0, 12.0, 30.0), "cubic")
    assert model.element[0] == Series((braced, braced, rubber, table)) and model.element[1:] == (None, None)
    assert model.damper[0] == Polynomial((40.0, 0.0, 5.0)) and model.damping[0] == 0.0 and model.damping[1] == 500.0
    assert np.abs(statics.residual(model)).max() < 1e-10  # the rest length comes from the law's inverse
    assert not list(jsonschema.Draft202012Validator(scene_schema()).iter_errors(raw))
    raw["strings"]["s1"]["damper"] = "valve"
    raw["strings"]["s1"]["element"] = "snapping"
    model = statics.build_model(parse_scene(raw))
    assert model.memories == model.elements == {0: Series((arch, arch, spring), "hysteretic")}
    assert model.damper[0] == Table((0.0, 0.1, 1.0), (0.0, 20.0, 30.0))
    assert np.abs(statics.residual(model)).max() < 1e-10


def test_an_element_without_end_needs_no_stiffness():
    text = WHOLE.replace('material = "cable", element = "stack"', 'element = "rubber"')
    assert statics.build_model(parse_scene(tomllib.loads(text))).stiffness[0] == pytest.approx(2000.0)


def test_a_tree_without_bounds_is_refused():
    raw = tomllib.loads(WHOLE)
    for i in range(1, 40):
        raw["elements"][f"e{i}"] = {"kind": "series", "parts": [f"e{i - 1}" if i > 1 else "rubber"] * 2}
    with pytest.raises(SceneError, match="at most 1000"):
        parse_scene(raw)


@pytest.mark.parametrize(
    "law, beams, zeta", [("hysteretic", "metastable", 4.0), ("hysteretic", "any", 9.0), ("hysteretic", "any", 1.5)]
)
def test_laws_of_an_nsh(law, beams, zeta):
    text = GOOD.replace("zeta = [3.0, 4.0]", f'zeta = [3.0, {zeta}]\nlaw = "{law}"\nbeams = "{beams}"')
    model = statics.build_model(parse_scene(tomllib.loads(text)))
    assert model.nsh[0] == NSH((6.0, 8.0), (3.0, zeta), (0.01, 0.02), law) and not model.nsh[0].metastable
    assert np.abs(statics.residual(model)).max() < 1e-10


# --- statics -----------------------------------------------------------------------------------------------------

ARTICLE = tuple(Beam(*beam) for beam in zip((6.0, 8.0, 10.0, 12.0), (3.0, 4.0, 5.0, 6.0), (0.01, 0.01, 0.015, 0.01)))
CELLS = Series((Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4)),) * 3, "hysteretic")


def hung(element=None, damper=None, nsh=None, k=5000.0, d=50.0, law="literal"):
    """The slider of test_reference with another string; its rest length is 1 m."""
    return replace(slider(0.0, 1.0, law=law, d=d, k=k), element=(element,), damper=(damper,), nsh=(nsh,))


def test_elongations_invert_the_loading_path():
    article = Series(ARTICLE, "hysteretic")
    for force in np.linspace(0.1, 60.0, 40):
        x = hysteresis.start(article, 5000.0).elongation(force)
        branch, _ = hysteresis.follow(hysteresis.start(article, 5000.0), x)
        assert branch.force(x) == pytest.approx(force, rel=1e-11)
    with pytest.raises(InputError, match="-1.0 N"):
        hysteresis.start(article, 5000.0).elongation(-1.0)


def test_settling_carries_the_state_along():
    """Under a force F on the slider the cells stretch until T = F; beyond 1 N they snap one after the other."""
    model = hung(CELLS, k=200.0)
    for force in (0.5, 0.9, 1.3):
        found = statics.settle(model, push_x(3, 2, force))
        x = found.nodes[1, 0] - 1.0
        # past the three snaps all cells are on their last stretch, f = .4 + 100 (u - .02)
        expected = force / 200.0 + 3.0 * (force / 100.0 if force < 1.0 else 0.02 + (force - 0.4) / 100.0)
        assert x == pytest.approx(expected, rel=1e-9)
        assert statics.string_branches(found, np.array([1.0 + x]))[0].snapped == (3 if force > 1.0 else 0)
    loaded = statics.settle(model, push_x(3, 2, 1.3))
    with pytest.raises(statics.NoEquilibrium, match="string s1 settles with 3 of its parts snapped"):
        statics.settle(loaded, push_x(3, 2, 0.5), force_before=push_x(3, 2, 1.3))


# --- the reference -----------------------------------------------------------------------------------------------

KINDS = {
    "article": hung(Series(ARTICLE, "hysteretic")),
    "nsh with memory": hung(nsh=NSH((6.0, 8.0), (3.0, 5.0), (0.01, 0.01), "hysteretic")),
    "bistable": hung(nsh=NSH((6.0, 8.0), (1.5, 9.0), (0.01, 0.02), "hysteretic")),
    "cells": hung(CELLS, k=200.0, d=5.0),
    "series": hung(Series((*ARTICLE[:2], Spring(3000.0), Polynomial((2000.0, 0.0, 1e6))))),
    "monotone nsh": hung(nsh=NSH((6.0, 8.0), (1.5, 4.0), (0.01, 0.01))),
    "parallel": hung(Parallel((ARTICLE[0], Spring(100.0), Table((0.0, 0.01, 0.02), (0.0, 1.0, 1.5), "cubic"))), k=4000.0),
    "table": hung(Table((0.0, 0.01, 0.02, 0.03), (0.0, 20.0, 30.0, 90.0))),
    "damper": hung(Polynomial((500.0, 0.0, 1e5)), Polynomial((20.0, 0.0, 3.0))),
    "valve": hung(Spring(500.0), Table((0.0, 0.1, 0.5, 1.0), (0.0, 5.0, 6.0, 20.0))),
}


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("kind", KINDS)
def test_ledger_closes_with_every_kind(kind, law):
    model = replace(KINDS[kind], damping_law=law)
    inputs = held(model, grid(0.6, 0.02), lambda t: push_x(3, 2, 60.0 if t % 0.4 < 0.2 else -20.0))
    inputs.rest_length[20:] += 0.004  # while stretched, so that input jumps are part of it
    result = reference.simulate(model, inputs)
    assert result.ledger_error() < 1e-8
    lost = sum(t.loss for t in result.transitions)
    assert (lost > 1e-4) == bool(model.memories)
    if law == "literal" and model.memories:
        undamped = reference.simulate(replace(model, damping=np.zeros(1)), inputs)
        assert undamped.ledger_error() < 1e-8
        assert undamped.dissipated[-1] == pytest.approx(sum(t.loss for t in undamped.transitions), rel=1e-8)


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_slow_stretching_follows_the_curve_with_memory(method):
    """A string between two anchors, whose rest length shrinks: T and the snaps are those of `follow`."""
    model = hung(CELLS, k=200.0, d=0.0)
    nodes = np.vstack((model.nodes, [1.0, 1.0, 0.0]))
    model = replace(
        model,
        node_names=("n1", "n2", "n3", "n4"),
        nodes=nodes,
        nominal=nodes,
        velocity=np.zeros((4, 3)),
        fixed=[True, False, False, True],
        strings=np.array([[0, 3]]),
        rest_length=[math.sqrt(2.0)],
    )
    inputs = held(model, grid(1.0, 0.05), None)
    there = np.where(np.arange(20) < 10, 1.0, -1.0)
    inputs.rest_length_rate[:, 0] = -0.16 * there
    inputs.rest_length[:, 0] = math.sqrt(2.0) - 0.16 * np.concatenate(([0.0], np.cumsum(0.05 * there)[:-1]))
    result = reference.simulate(model, inputs, method=method)
    snaps = [t for t in result.transitions if t.loss > 0.0]
    np.testing.assert_allclose([0.16 * t.time for t in snaps[:3]], [0.035, 0.051, 0.067], rtol=1e-9)
    np.testing.assert_allclose([0.16 * (1.0 - t.time) for t in snaps[3:]], [0.062, 0.046, 0.030], rtol=1e-9)
    assert [(t.before, t.after) for t in snaps] == [(1, 2), (2, 3), (3, 4), (4, 3), (3, 2), (2, 1)]
    assert result.dissipated[-1] == pytest.approx(48e-3 / 7.0, rel=1e-9)
    assert result.ledger_error() < 1e-9 and result.input_work[-1] == pytest.approx(48e-3 / 7.0, rel=1e-6)


def test_a_jump_of_the_rest_length_passes_all_snaps_on_its_way():
    model = hung(CELLS, k=200.0, d=0.0)
    inputs = held(model, grid(0.02, 0.01))
    inputs.rest_length[1] -= 0.08
    result = reference.simulate(model, inputs)
    (jump,) = [t for t in result.transitions if t.time == 0.01]
    assert jump.loss == pytest.approx(3 * 8e-3 / 7.0, rel=1e-12) and (jump.before, jump.after) == (0, 4)
    branch, _ = hysteresis.follow(hysteresis.start(CELLS, 200.0), 0.08)
    put_in = branch.energy(0.08) + jump.loss
    assert result.input_work[-1] == pytest.approx(put_in, rel=1e-12) and result.ledger_error() < 1e-12


def test_a_polynomial_damper_in_closed_form():
    """m v' = -c v |v| on a string that pays out no force otherwise: v = v0 / (1 + c v0 t / m)."""
    nothing = Table((0.0, 1e3, 2e3), (0.0, 0.0, 1.0))
    model = replace(slider(0.7, 0.5, d=0.0), element=(nothing,), damper=(Polynomial((0.0, 4.0)),))
    result = reference.simulate(model, held(model, grid(0.5, 0.1)), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(result.velocity[:, 1, 0], 0.7 / (1.0 + 4.0 * 0.7 * result.times), rtol=1e-10)
    np.testing.assert_allclose(result.dissipated, 0.5 * (0.49 - result.velocity[:, 1, 0] ** 2), atol=1e-10)
