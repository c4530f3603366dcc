"""Tensegrities that other people published, against numbers that they and independent scripts have (tests/structures).

The scenes were transcribed from the repositories that they name; recorded.json has their rank, states of self-stress,
mechanisms and bar forces, and positions over time with the accuracy of these, m; `changes`: keys of the scene that were other
there, such as bars that are hinged and not welded.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tensegrity_core import load, reference, statics
from tensegrity_core.model import Inputs, held

FOLDER = Path(__file__).parents[1] / "structures"
RECORDED = json.loads((FOLDER / "recorded.json").read_text(encoding="utf-8"))
TIGHT = {"rtol": 1e-12, "atol": 1e-13}


def structure(name, **changes):
    return load(FOLDER / f"{name}.toml", changes)


@pytest.mark.parametrize("name", RECORDED)
def test_statics(name):
    known = RECORDED[name]
    model = structure(name, **known.get("changes", {}))
    found = statics.analyse(model)
    assert (found.equations, found.members, found.rank) == (known["free"], known["members"], known["rank"])
    assert found.self_stress.shape[1] == known["self_stress"]
    assert len(found.mechanisms) + found.rigid_body_motions == known["mechanisms"]
    assert (
        found.equations - np.linalg.matrix_rank(statics.equilibrium_matrix(model)[:, len(model.strings) :]) == known["motions"]
    )
    assert model.redundant.sum() == known["redundant"]
    matrix = statics.equilibrium_matrix(model)
    stretch = np.array([matrix.T @ statics.free_rows(model, field) for field in found.mechanisms])
    assert np.abs(stretch).max(initial=0.0) < 1e-12
    assert np.abs(matrix @ found.self_stress).max(initial=0.0) < 1e-12


@pytest.mark.parametrize("name", [name for name, known in RECORDED.items() if "bar_forces" in known])
def test_forces_of_equilibrium(name):
    """Scenes with start = "equilibrium" are refused unless they balance; the bars' forces then are those on record, up to what
    a round-off in the rest lengths makes of stiff strings: in the wheel 3e-8 of 0.3 N."""
    model, known = structure(name), RECORDED[name]["bar_forces"]
    forces = dict(zip(model.bar_names, statics.member_forces(model)[len(model.strings) :]))
    round_off = 4.0 * np.finfo(float).eps * float((model.stiffness * model.rest_length).max())
    assert forces == pytest.approx(known, rel=1e-9, abs=round_off)
    assert statics.stability(model).stable


def largest_error(model, result, known, rows):
    """m, at the instants on record, which are every so many rows."""
    return max(
        float(np.abs(result.position[::rows, model.node_names.index(node)][: len(way)] - way).max())
        for node, way in known["positions"].items()
    )


def pushed(model, node, force):
    found = np.zeros((len(model.nodes), 3))
    found[model.node_names.index(node)] = force
    return lambda t: found


@pytest.mark.parametrize(
    "name, gravity, node, force",
    [
        ("motes_double_pendulum", [0.0, -9.8, 0.0], "n3", [0.0, 0.0, 0.0]),
        ("stedy_dbar", [0.0, 0.0, -9.81], "n3", [2.0, 0.0, 0.0]),
        ("tsg_jansen_leg", [0.0, -9.8, 0.0], "n8", [100.0, 0.0, 0.0]),
        ("tsg_dbar3d", [0.0, 0.0, -9.81], "n5", [0.0, 200.0, 0.0]),
        ("cts_tbar", [0.0, -9.81, 0.0], "n3", [20.0, 0.0, 0.0]),
    ],
)
def test_trajectories(name, gravity, node, force):
    """Under constant forces, from rest."""
    model, known = structure(name, gravity=gravity, start="released"), RECORDED[name]["trajectory"]
    times = np.array(known["times"])
    result = reference.simulate(model, held(model, times, force=pushed(model, node, force)), **TIGHT)
    assert largest_error(model, result, known, 1) < 1e-11 < 1e-8
    assert result.ledger_error() < 1e-9
    lengths = np.linalg.norm(result.position[:, model.bars[:, 1]] - result.position[:, model.bars[:, 0]], axis=2)
    np.testing.assert_allclose(lengths, np.tile(model.bar_length, (len(times), 1)), rtol=1e-14)


def test_trajectory_of_a_ball_under_changing_forces():
    """Forces are held over a step, so that of its middle is given; that errs by the square of the step, 4e-8 m at 1 ms."""
    model, known = structure("stedy_ball"), RECORDED["stedy_ball"]["trajectory"]
    step, last = 2.5e-4, 2

    def force(t):
        found = np.zeros((len(model.nodes), 3))
        for node, axis in (("n4", 0), ("n7", 1), ("n8", 2)):
            found[model.node_names.index(node), axis] = 30.0 * np.sin(t + 0.5 * step)
        return found

    rows = round(known["times"][1] / step)
    known = {"positions": {node: way[:last] for node, way in known["positions"].items()}}
    result = reference.simulate(model, held(model, step * np.arange((last - 1) * rows + 1), force=force))
    assert largest_error(model, result, known, rows) < 1e-8


def test_trajectory_of_a_ball_that_jumps():
    """Off the ground and back on it, with twenty changes of contact, at the tolerances that nobody chose for it."""
    model, known = structure("besson_superball_jump"), RECORDED["besson_superball_jump"]["trajectory"]
    result = reference.simulate(model, held(model, np.array(known["times"])))
    assert largest_error(model, result, known, 1) < 1e-8
    assert sum(transition.contact >= 0 for transition in result.transitions) == 20
    assert result.ledger_error() < 1e-9


def test_trajectory_of_a_turned_crank():
    """The leg's crank turns once; where its nodes are follows from the bars' lengths alone.  The crank itself, between a fixed
    and a moved node, is redundant."""
    fixed = ["n1", "n5", "n2", *(f"n{i}.z" for i in (3, 4, 6, 7, 8))]
    model, known = structure("tsg_jansen_leg", fixed=fixed, moving=["n2"]), RECORDED["tsg_jansen_leg"]["trajectory_moved"]
    times = np.linspace(0.0, 1.0, 101)
    angle = 0.5 * np.pi - 2.0 * np.pi * (10 * times**3 - 15 * times**4 + 6 * times**5)
    rate = -2.0 * np.pi * (30 * times**2 - 60 * times**3 + 30 * times**4)
    place = model.nodes[0] + 15.0 * np.array([np.cos(angle), np.sin(angle), 0.0 * angle]).T
    speed = 15.0 * np.array([-rate * np.sin(angle), rate * np.cos(angle), 0.0 * angle]).T
    step = np.diff(times)[:, None]
    bend = 2.0 * (np.diff(place, axis=0) - step * speed[:-1]) / step**2  # so that every step ends where the next begins
    inputs = Inputs(times, node_position=place[:-1, None], node_velocity=speed[:-1, None], node_acceleration=bend[:, None])
    assert [model.bar_names[i] for i in np.flatnonzero(model.redundant)] == ["b1"]
    result = reference.simulate(model, inputs.resolved(model))
    assert largest_error(model, result, known, 20) < 1e-10
