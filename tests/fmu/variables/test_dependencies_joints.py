"""What descriptions list as dependencies at the start, of structures with joints, against differences of the reference: where
nothing is listed, nothing changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_src.variables.dependencies import Places, initial_dependencies
from tensegrity_core import reference
from tensegrity_core.errors import InputError
from tensegrity_core.fields import FIELDS, outputs
from tensegrity_core.model import Inputs
from tensegrity_core.model.components import flattened, named, spread
from tensegrity_core.model.inputs import INPUTS, starts
from tests.support.driven_scenes import built
from tests.support.jointed_scenes import SLIDER, random_joints

#: Parameters of which the reference can be asked, and the arrays of the model that hold them.
PARAMETERS = ("stiffness", "damping", "gravity", "drag", "bar_mass", "point_mass")
#: Of the largest value of an output: below it is round-off.
ROUND_OFF = 1e-9


def at_the_start(model, inputs):
    """All outputs at the start, by field, flat."""
    held = Inputs(np.array([0.0, 1e-9]), **{name: value[None] for name, value in inputs.items()}).resolved(model)
    found = reference.simulate(model, held)
    return {field.name: flattened(field, model, found.outputs[field.name][:1])[0] for field in outputs()}


def knowns(model):
    """(reference, place in its field, model and inputs with that one changed)."""
    table, start = Places(model), starts(model)
    for name, field in INPUTS.items():
        flat = flattened(field, model, start[name][None])[0]
        for place in named(field, model).values():
            changed = flat.copy()
            changed[place] += 0.01 if name == "rest_length" else 0.02
            yield table.at(name, place), model, start | {name: spread(field, model, changed[None])[0]}
    for name in PARAMETERS:
        field = next(field for field in FIELDS if field.name == name)
        for place in named(field, model).values():
            yield table.at(name, place), altered(model, name, place), start


def altered(model, name, place):
    if name in ("drag", "point_mass"):
        pairs = list(getattr(model, name))
        pairs[place] = (pairs[place][0], 1.5 * pairs[place][1])
        return replace(model, **{name: tuple(pairs)})
    if name == "gravity":
        if np.ndim(model.gravity) == 0:
            return replace(model, gravity=model.gravity + 1.0)
        return replace(model, gravity=tuple(np.add(model.gravity, np.eye(3)[model.axes[place]])))
    return replace(model, **{name: getattr(model, name) * np.where(np.arange(len(getattr(model, name))) == place, 1.5, 1.0)})


def uncovered(model):
    """Outputs and what they change with and do not list; how many of those listed change them."""
    listed, table = initial_dependencies(model), Places(model)
    names = {table.at(field.name, i): name for field in FIELDS for name, i in named(field, model).items()}
    start, found, met = at_the_start(model, starts(model)), [], 0
    for known, other, inputs in knowns(model):
        try:
            after = at_the_start(other, inputs)
        except InputError:  # a moved node that would stretch a bar
            continue
        for field in outputs():
            size = max(1e-3, np.abs(start[field.name]).max(initial=0.0), np.abs(after[field.name]).max(initial=0.0))
            for place in named(field, model).values() if field in FIELDS else ():
                if abs(after[field.name][place] - start[field.name][place]) <= ROUND_OFF * size:
                    continue
                met += 1
                if known not in listed.get(table.at(field.name, place), ()):
                    found.append((names[table.at(field.name, place)], names[known]))
    return found, met


@pytest.mark.parametrize("seed", [0, 3, 6, 9])
def test_lists_cover_what_changes_at_the_start(seed):
    """Redundant bars, bars without mass, welds, single axes, start velocities."""
    model = random_joints(seed)
    assert model.joint
    found, met = uncovered(model)
    assert found == [] and met > 20


def test_lists_cover_moved_axes():
    """A start in motion whose nodes are moved along single axes."""
    model = built(
        SLIDER
        | {"velocities": {"n2": [0.3, 0.0, 0.0]} | {key: [0.3, 0.0, 0.0] for key in ("n3", "n4")}}
        | {"moving": ["n2.z"]}
        | SLID
    )
    assert model.velocity.any()
    found, met = uncovered(model)
    assert found == [] and met > 20


#: Without the bar to a fixed node, so that all of it can slide.
SLID = {"bars": {name: bar for name, bar in SLIDER["bars"].items() if name != "b3"}}


def test_an_unlisted_dependency_is_found(monkeypatch):
    model = random_joints(3)
    monkeypatch.setattr(Places, "group_force", lambda self, b: set())
    assert uncovered(model)[0]
