"""Fills the page: what it is told of a model and of a run, beside the bundle and the kernel."""

from __future__ import annotations

import base64
import gzip
import json
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...fields import FIELDS, INTEGER_FIELDS, METHOD_MEANINGS, STATS, layout, outputs
from ...files import write_text
from ...kernel import Kernel, to_bytes
from ...laws.beam import beam_extrema
from ...model import NSH, Model, Result
from ...model.components import flattened
from ...model.inputs import INPUTS
from ...model.routes import longest_segment
from .made import Parts, parts

#: Numbers of a run that a page holds at most; of a longer run it holds every second, third ... instant.
MOST_NUMBERS = 120_000
ENERGIES = ("kinetic", "potential", "elastic", "dissipated", "input_work")


def page(model: Model, result: Result | None = None, force: np.ndarray | None = None, common: Parts | None = None) -> str:
    """The page of a model, as HTML: the kernel runs in it, or it plays a result back.

    force: (N, 3) N, constant forces on the free nodes, or (K+1, N, 3) N, those of a run: drawn as arrows; common: bundle and
    kernel, by default those of `parts`, which are built where they are missing.  Raises TensegrityError where they cannot be.
    """
    common = common or parts()
    told = _structure(model)
    if result is None:
        told["packed"] = packed(to_bytes(model))
        told["force"] = [] if force is None or not np.any(force) else _flat_force(model, np.asarray(force)[None])[0].tolist()
    else:
        told["run"] = _run(model, result, force)
    fill = {
        "TITLE": escape(model.name),
        "DESCRIPTION": escape(model.description),
        "GENERATOR": f"tensegrity {__version__}",
        "STYLE": common.style,
        "MODEL": _script_safe(json.dumps(told, separators=(",", ":"), allow_nan=False)),
        "KERNEL": packed(common.kernel) if result is None else "",
        "SCRIPT": common.script,
    }
    text = common.template
    head, *rest = text.split("@")
    pieces = [head]  # in one pass, so that nothing that is filled in is read as a mark
    for name, between in zip(rest[::2], rest[1::2]):
        pieces += [fill.get(name, f"@{name}@"), between]
    return "".join(pieces)


def write_page(path: Path, model: Model, result: Result | None = None, force: np.ndarray | None = None) -> int:
    """Write the page, whole or not at all; returns its size in bytes.  See `page`."""
    text = page(model, result, force)
    write_text(path, text)
    return len(text.encode())


def packed(content: bytes) -> str:
    """Bytes as the page reads them (web/encoded.js); the same bytes give the same text."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode("ascii")


def _script_safe(text: str) -> str:
    """JSON that ends no script, whatever names are in it."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _structure(model: Model) -> dict[str, Any]:
    """What web/model.js is told."""
    kernel = Kernel(model)
    kernel.initialize(0.0)
    return {
        "name": model.name,
        "description": model.description,
        "axes": list(model.axes),
        "nodeNames": list(model.node_names),
        "barNames": list(model.bar_names),
        "stringNames": list(model.string_names),
        "nodes": model.nodes.tolist(),
        "free": model.free_nodes.tolist(),
        "grounded": model.fixed_nodes.tolist(),
        "bars": model.bars.tolist(),
        "strings": model.strings.tolist(),
        "paths": [list(path) for path in model.paths],
        "twoWay": model.two_way.tolist(),
        "barLengths": model.bar_length.tolist(),
        "startLengths": model.string_lengths(model.nodes).tolist(),
        "restLengths": model.rest_length.tolist(),
        "actuated": list(model.actuated),
        "memories": list(model.memories),
        "cellsOn": dict(zip(map(str, model.honeycombs), (_cells_on(model, string) for string in model.honeycombs))),
        "honeycombs": [_honeycomb(string, nsh) for string, nsh in model.honeycombs.items()],
        "snappedBy": [_snapped_by(kernel, model, string) for string in range(len(model.strings))],
        "atStart": {"tension": float(np.max(kernel["string_force"], initial=0.0))}
        | {name: float(kernel[name][0]) for name in ENERGIES},
        "fields": {name: [at.start, at.stop] for name, at in layout(model.counts).items()},
        "integers": {name: [at.start, at.stop] for name, at in layout(model.counts, INTEGER_FIELDS).items()},
        "methods": list(METHOD_MEANINGS.items()),
        "stats": list(STATS),
    }


def _cells_on(model: Model, string: int) -> dict[str, Any]:
    """The segment of an NSH string on which its cells are drawn, and that one's length at the start, m."""
    segment, length = longest_segment(model, string)
    return {"segment": segment, "start": length}


def _honeycomb(string: int, nsh: NSH) -> dict[str, Any]:
    """Its beams in the order in which they snap, and in that in which they return; a beam that does neither comes last."""
    beams = list(zip(nsh.Q, nsh.zeta, nsh.h))
    ends = [beam_extrema(*beam) if beam[1] > 2.0 else None for beam in beams]
    maximum = [end.f_max if end else np.inf for end in ends]
    minimum = [end.f_min if end else -np.inf for end in ends]
    rise = sorted(range(len(beams)), key=lambda beam: maximum[beam])
    fall = sorted(range(len(beams)), key=lambda beam: -minimum[beam]) if nsh.law == "hysteretic" else rise[::-1]
    return {"string": string, "beams": len(beams), "rise": rise, "fall": fall}


def _snapped_by(kernel: Kernel, model: Model, string: int) -> list[int] | None:
    """Of an NSH string: how many beams have snapped on each of the pieces that transitions name."""
    if string not in model.honeycombs:
        return None
    pieces = len(kernel.pieces(string))
    return [kernel.snapped_on(string, piece) for piece in range(pieces)]


def _run(model: Model, result: Result, force: np.ndarray | None) -> dict[str, Any]:
    """What web/playback.js is told: instants in rows, outputs in the kernel's order."""
    reals = [field for field in outputs() if field in FIELDS]
    rows = np.hstack(
        [
            flattened(field, model, result.outputs[field.name]) if field.shape else result.outputs[field.name][:, None]
            for field in reals
        ]
    )
    step = max(1, -(-rows.size // MOST_NUMBERS))
    kept = np.unique(np.append(np.arange(0, len(rows), step), len(rows) - 1))
    events = [[t.time, t.string, t.before, t.after, t.loss] for t in result.transitions if t.contact < 0]
    told: dict[str, Any] = {
        "times": packed(result.times[kept].astype("<f8").tobytes()),
        "values": packed(rows[kept].astype("<f4").tobytes()),
        "snapped": packed(result.snapped[kept].astype("<f4").tobytes()),
        "transitions": events if events or result.stats else None,  # a file may have kept neither
        "every": step,
        "instants": len(rows),
    }
    if force is not None:
        rows = _flat_force(model, np.broadcast_to(force, (len(rows), len(model.nodes), 3)))
        told["force"] = packed(rows[kept].astype("<f4").tobytes())
    return told


def _flat_force(model: Model, force: np.ndarray) -> np.ndarray:
    """(rows, forces of the free nodes along the axes) N."""
    return flattened(INPUTS["force"], model, force)
