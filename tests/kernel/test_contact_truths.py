"""Contact with the ground: kernel and reference, two programs that share the scene's data only.

Random scenes are seeded: `python -m tests.kernel.test_contact_truths COUNT` compares COUNT of them.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tensegrity_core import reference
from tensegrity_core.kernel.run import simulate
from tensegrity_core.model import Contact, Ground, Inputs, grid, held
from tensegrity_core.scene import load_scene, parse_scene
from tensegrity_core.statics import build_model
from tests.support.ground_scenes import random_drives, random_ground
from tests.support.touching import ledger, mass, moving, rod, thrown
from tests.support.words import words


def _fallen():
    """The three-bar prism with its honeycombs, no longer held, over a slope."""
    model = build_model(load_scene("three_bar_nsh"))
    ground = Ground(point=(0.0, 0.0, -0.3), normal=tuple(np.array([0.3, 0.0, 1.0]) / math.sqrt(1.09)))
    contacts = tuple(Contact(node, 5e3, 0.3, 5e3, 0.4) for node in range(6))
    return dataclasses.replace(model, fixed=np.zeros(6, dtype=bool), ground=ground, contacts=contacts)


def _swing(model, end):
    rate = 7.0
    return held(model, grid(end, 0.01), ground=lambda t: (0.02 * math.sin(rate * t), 0.02 * rate * math.cos(rate * t)))


def _jumps(model, end):
    times = grid(end, 0.01)
    height = np.where(np.arange(len(times) - 1) // 15 % 2, 0.01, 0.0)[:, None]
    return Inputs(times, ground_height=height).resolved(model)


def _still(model, end):
    return held(model, grid(end, 0.01))


CASES = {
    "a mass that bounces and slides on its way round": (
        mass((0.0, 0.0, 0.05), (1.0, -0.5, 0.0), c=0.3, mu=0.3, kt=1e4, gravity=(0.5, 2.0, -9.81)),
        _still,
        0.6,
    ),
    "a spinning bar": (thrown(), _still, 0.6),
    "a bar in the plane on a ground that swings": (
        moving(rod((0.0, 0.0, 0.05), (1.0, 0.0, 0.1), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0), c=0.2, mu=0.4, planar=True)),
        _swing,
        0.8,
    ),
    "a bar on a ground that jumps": (moving(rod((-0.5, 0.0, 0.0), (0.5, 0.1, 0.02), c=0.2, mu=0.4)), _jumps, 0.6),
}


def _lasting(result):
    """Transitions without those that are undone at once, as at the end of a slip beside the lift-off."""
    kept = []
    for one in result.transitions:
        undone = [t for t in kept if (t.contact, t.string) == (one.contact, one.string) and one.time - t.time < 1e-7]
        if undone and (undone[-1].before, undone[-1].after) == (one.after, one.before):
            kept.remove(undone[-1])
        else:
            kept.append(one)
    return kept


def compare(model, inputs, room=1e-7):
    truth = reference.simulate(model, inputs)
    for method in ("auto", "radau9"):
        found = simulate(model, inputs, method, 1e-11)
        assert np.abs(found.position - truth.position).max() < room
        assert np.abs(found.contact_normal - truth.contact_normal).max() < 1e6 * room
        assert np.abs(found.contact_force - truth.contact_force).max() < 1e6 * room
        for name in ("elastic", "dissipated", "input_work"):
            assert np.abs(getattr(found, name) - getattr(truth, name)).max() < 10.0 * room
        ours, theirs = _lasting(found), _lasting(truth)
        assert [(t.contact, t.string, t.kind) for t in ours] == [(t.contact, t.string, t.kind) for t in theirs]
        assert max(abs(a.time - b.time) for a, b in zip(ours, theirs)) < 1e-7
        assert (found.contact_sticking == truth.contact_sticking).all()
        assert ledger(found) < 1e-8
    return truth


@pytest.mark.parametrize("name", CASES)
def test_kernel_and_reference_agree(name):
    model, inputs, end = CASES[name]
    truth = compare(model, inputs(model, end))
    assert len(truth.transitions) > 8


def test_a_prism_falls():
    """Strings with honeycombs go slack and taut while nodes touch, stick and slip on a slope."""
    model = _fallen()
    inputs = held(model, grid(0.5, 0.02))
    truth = compare(model, inputs)
    touched = {t.contact for t in truth.transitions if t.contact >= 0}
    assert len(touched) >= 3 and any(t.contact < 0 for t in truth.transitions)


def test_three_bars_that_meet_and_no_strings():
    """A step that the reference tries there is far too long: it takes it back."""
    nodes = {"a": (0.0, 0.0, 0.6), "b": (0.5, 0.0, 0.2), "c": (-0.3, 0.4, 0.2), "d": (-0.3, -0.4, 0.25)}
    bars = {f"b{end}": {"nodes": ("a", end), "mass": mass} for end, mass in (("b", 1.0), ("c", 0.7), ("d", 0.9))}
    table = {"name": "tripod", "start": "released", "nodes": nodes, "bars": bars}
    table["ground"] = {"stiffness": 2e4, "damping": 0.2, "friction": 0.4}
    model = build_model(parse_scene(table))
    compare(model, held(model, grid(0.5, 0.02)))


def apart(seed: int, joints: bool) -> tuple[float, float, int]:
    """Of a random scene: largest difference of positions, m; error of the ledger; transitions, equal in number."""
    model = random_ground(seed, joints)
    inputs = random_drives(model, seed, 3)
    truth, found = reference.simulate(model, inputs), simulate(model, inputs, "auto", 1e-11)
    assert len(_lasting(found)) == len(_lasting(truth))
    return float(np.abs(found.position - truth.position).max()), ledger(found), len(found.transitions)


@pytest.mark.parametrize("joints", [False, True])
def test_random_scenes(joints):
    """Bars, strings, masses and drag on planes that move; with joints and nodes that are held along an axis."""
    rows = [apart(seed, joints) for seed in range(4, 8)]
    assert max(row[0] for row in rows) < 1e-8
    assert max(row[1] for row in rows) < 1e-8
    assert sum(row[2] for row in rows) > 20


if __name__ == "__main__":
    (count,) = words(__doc__, int)
    found = [apart(seed, joints) for seed in range(count) for joints in (False, True)]
    differences, gaps, transitions = zip(*found)
    print(f"{2 * count} scenes, {sum(transitions)} transitions: {max(differences):.1e} m, ledger {max(gaps):.1e}")
