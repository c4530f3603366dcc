"""Shared by the tests: built-in scenes as models, and small changes to them."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tensegrity_core.model import Model, Result
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model


@cache
def scene(name: str) -> Model:
    """A built-in scene's model."""
    return build_model(load_scene(name))


def changed(model: Model, damping: float | None = None, stiffness_factor: float = 1.0, **fields) -> Model:
    """The model with one damping coefficient for all strings (N.s/m), scaled stiffness, or other fields."""
    if damping is not None:
        fields["damping"] = np.full(len(model.strings), float(damping))
    if stiffness_factor != 1.0:
        fields["stiffness"] = model.stiffness * stiffness_factor
    return dataclasses.replace(model, **fields)


def by_hand(nodes, fixed, bars, strings, **fields) -> Model:
    """A model without a scene, of pairs of nodes that are joined, of strings also more nodes in order.  fixed: indices of the
    fixed nodes; fields: of Model, one number where it is the same for all bars or strings."""
    routes = tuple((i, tuple(path)) for i, path in enumerate(strings) if len(path) > 2)
    nodes, strings = np.array(nodes, dtype=float), [path[:2] for path in strings]
    counts = {"node_names": len(nodes), "bar_names": len(bars), "string_names": len(strings)}
    known = {names: tuple(f"{names[0]}{i + 1}" for i in range(count)) for names, count in counts.items()}
    known |= {"name": "by_hand", "description": "", "axes": (0, 1, 2), "nsh": (None,) * len(strings), "damping_law": "literal"}
    known |= {"gravity": 0.0, "nominal": nodes, "bar_mass": 1.0, "damping": 0.0, "routes": routes} | fields
    for name, count in (("bar_mass", len(bars)), *((name, len(strings)) for name in ("stiffness", "damping", "rest_length"))):
        known[name] = np.broadcast_to(known[name], count)
    return Model(nodes=nodes, fixed=np.isin(np.arange(len(nodes)), fixed), bars=bars, strings=strings, **known)


def push(model: Model, up: float = 45.0, aside: float = 20.0) -> np.ndarray:
    """(N, 3) N: `up` on every top node, and `aside` in x on the first of them."""
    force = np.zeros((len(model.nodes), 3))
    top = np.flatnonzero(model.nodes[:, 2] > model.nodes[:, 2].max() - 0.01)
    force[top, 2] = up
    force[top[0], 0] = aside
    return force


def same_picture(drawn: Path, kept: Path) -> None:
    """Whether a figure shows what the kept one shows.  Letters and panels have other sizes in another version of Matplotlib:
    then only about as much must be drawn on as large a sheet."""
    pictures = [Image.open(path) for path in (drawn, kept)]
    one, other = (np.asarray(picture.convert("L"), dtype=float) for picture in pictures)
    assert one.shape == other.shape and drawn.stat().st_size < 250_000
    assert np.mean(one < 200.0) == pytest.approx(np.mean(other < 200.0), rel=0.2)
    if pictures[0].text["Software"] == pictures[1].text["Software"]:
        apart = np.mean(np.abs(one - other) > 64.0)
        assert apart < 1e-4, f"{apart:.2%} of the points of {kept.name} differ"


def same_outputs(outputs: dict[str, np.ndarray], expected: Result) -> None:
    """Whether an FMU gave what the kernel gives."""
    for name, known in expected.outputs.items():
        np.testing.assert_allclose(outputs[name], known, rtol=1e-12, atol=1e-12, err_msg=name)
