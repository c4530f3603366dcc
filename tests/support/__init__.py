"""Shared by the tests: built-in scenes as models, and small changes to them."""

from __future__ import annotations

import dataclasses
import re
from functools import cache
from xml.etree import ElementTree

import numpy as np

from tensegrity_core.model import Model
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


def push(model: Model, up: float = 45.0, aside: float = 20.0) -> np.ndarray:
    """(N, 3) N: `up` on every top node, and `aside` in x on the first of them."""
    force = np.zeros((len(model.nodes), 3))
    top = np.flatnonzero(model.nodes[:, 2] > model.nodes[:, 2].max() - 0.01)
    force[top, 2] = up
    force[top[0], 0] = aside
    return force


SVG = "{http://www.w3.org/2000/svg}"
LINK = "{http://www.w3.org/1999/xlink}href"


def drawn(svg: str) -> tuple[list[str], list[np.ndarray]]:
    """What a figure of matplotlib shows, whatever version drew it: its texts but for those of ticks, sorted, and of every mark
    in its panels the extent in parts of the panel's box, (2, 2), or of a run of markers all places, (n, 2).

    The letters' widths, the panels' sizes and all ids differ between versions, and ids even between processors.
    """
    texts, marks = [], []

    def visit(element, box):
        name = element.get("id", "")
        if name.startswith(("xtick_", "ytick_")) or element.tag in (SVG + "defs", SVG + "metadata"):
            return
        if element.tag == SVG + "text":
            texts.append("".join(element.itertext()).strip())
        if name.startswith("axes_"):
            frame = element.find(f"{SVG}g/{SVG}path")
            box = None if frame is None else _points(frame.get("d"))
        elif name.startswith(("legend_", "text_")):
            box = None
        if box is not None and element.tag == SVG + "path" and element.get("d"):
            points = (_points(element.get("d")) - box.min(axis=0)) / np.ptp(box, axis=0)
            marks.append(np.array([points.min(axis=0), points.max(axis=0)]))
        uses = [use for use in element if use.tag == SVG + "use"]
        if box is not None and uses:
            points = np.array([[float(use.get("x")), float(use.get("y"))] for use in uses])
            marks.append((points - box.min(axis=0)) / np.ptp(box, axis=0))
        for child in element:
            visit(child, box)

    visit(ElementTree.fromstring(svg), None)
    return sorted(texts), marks


def _points(path: str) -> np.ndarray:
    return np.array(re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", path), dtype=float).reshape(-1, 2)
