"""A mast with two guys of general force laws: for the tests of kernel, reference and FMUs."""

import numpy as np

from tensegrity_core.model import grid, held
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.support.driven_scenes import POLE

MAST = POLE | {
    "nsh": {
        "snap": {"Q": [6.0, 10.0, 8.0], "zeta": [4.0, 5.0, 6.0], "h": [0.01, 0.015, 0.01]},
        "memory": {"Q": [6.0, 10.0, 8.0], "zeta": [4.0, 5.0, 6.0], "h": [0.01, 0.015, 0.01], "law": "hysteretic"},
        "bistable": {"Q": [6.0, 10.0], "zeta": [9.5, 5.0], "h": [0.01, 0.015], "law": "hysteretic", "beams": "any"},
    },
    "elements": {
        "hard": {"kind": "spring", "stiffness": 3000.0},
        "soft": {"kind": "spring", "stiffness": 400.0},
        "beam": {"kind": "beam", "Q": 6.0, "zeta": 5.0, "h": 0.015},
        "thick": {"kind": "beam", "Q": 9.0, "zeta": 4.0, "h": 0.01},
        "flat": {"kind": "beam", "Q": 6.0, "zeta": 1.5, "h": 0.01, "beams": "any"},
        "cell": {"kind": "table", "elongation": [0.0, 0.01, 0.02, 0.03], "force": [0.0, 8.0, 4.0, 20.0]},
        "kinked": {"kind": "table", "elongation": [0.0, 0.01, 0.03, 0.06], "force": [0.0, 5.0, 9.0, 60.0]},
        "smooth": {
            "kind": "table",
            "elongation": [0.0, 0.01, 0.03, 0.06],
            "force": [0.0, 5.0, 9.0, 60.0],
            "interpolation": "cubic",
        },
        "hardening": {"kind": "polynomial", "coefficients": [600.0, 0.0, 4.0e5]},
        "chain": {"kind": "series", "parts": ["hard", "beam", "thick"]},
        "monotone": {"kind": "series", "parts": ["flat", "beam", "flat"]},
        "pair": {"kind": "parallel", "parts": ["soft", "beam"]},
        "nested": {"kind": "series", "parts": ["hard", "pair", "kinked"]},
        "cells": {"kind": "series", "parts": ["cell", "cell", "cell"], "law": "hysteretic"},
        "mixed": {"kind": "series", "parts": ["beam", "pair", "hard"], "law": "hysteretic"},
    },
    "dampers": {
        "progressive": {"coefficients": [15.0, 0.0, 30.0]},
        "valve": {"rate": [0.0, 0.1, 0.4], "force": [0.0, 4.0, 6.0]},
        "round": {"rate": [0.0, 0.1, 0.4], "force": [0.0, 4.0, 6.0], "interpolation": "cubic"},
    },
    "strings": {
        "s1": {"nodes": ["n3", "n2"], "material": "cable"},
        "s2": {"nodes": ["n4", "n2"], "material": "cable"},
    },
    "prestress": {"tension": {"s2": 5.0}},
}

#: Name -> the keys of string s1.
STRINGS = {
    name: {"material": "cable", "element": name}
    for name in ("chain", "monotone", "pair", "nested", "kinked", "smooth", "hardening", "cells", "mixed")
}
STRINGS |= {name: {"material": "cable", "nsh": name} for name in ("snap", "memory", "bistable")}
STRINGS |= {name: {"stiffness": 2000.0, "damper": name} for name in ("progressive", "valve", "round")}


def mast(name: str, **changes):
    """The mast with a string s1 of one of STRINGS."""
    strings = MAST["strings"] | {"s1": {"nodes": ["n3", "n2"], **STRINGS[name]}}
    return build_model(parse_scene(MAST | {"strings": strings} | changes))


def swaying(model, duration=1.0, size=40.0, step=0.02):
    """Inputs that stretch s1 far and let it go slack, with jumps of force and of a rest length on the way."""
    push = np.zeros((len(model.nodes), 3))
    push[1, 0] = size

    def rest_length(t):
        return model.rest_length + np.array([0.02 * np.sin(5.0 * t) + (0.01 if t > 0.61 * duration else 0.0), 0.0])

    return held(model, grid(duration, step), force=lambda t: push * np.sin(9.0 * t), rest_length=rest_length)
