"""Small scenes with what moves, loads or slows down a structure: for the tests of kernel, reference and FMUs."""

from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model

#: A pendulum of 1 m and 2 kg with a mass at its tip, its pivot moved; 30 degrees off the vertical.
PENDULUM = {
    "name": "pendulum",
    "plane": "xz",
    "start": "released",
    "fixed": ["n1"],
    "nodes": {"n1": [0.0, 0.0], "n2": [0.5, -0.8660254037844386]},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 2.0}},
}

#: A bar afloat in space.
AFLOAT = {
    "name": "afloat",
    "start": "released",
    "gravity": 0.0,
    "nodes": {"n1": [0.0, 0.0, 0.0], "n2": [0.6, 0.0, 0.8]},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 1.0}},
}

#: A mast and where its two guys are held.
POLE = {
    "name": "mast",
    "plane": "xz",
    "fixed": ["n1", "n3", "n4"],
    "nodes": {"n1": [0.0, 0.0], "n2": [0.0, 1.0], "n3": [-0.6, 0.0], "n4": [0.6, 0.0]},
    "materials": {"cable": {"stiffness": 2000.0, "damping": 20.0}},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 1.0}},
}

#: A mast with two guys, one of them wound by a motor.
MAST = POLE | {
    "actuators": {"winch": {"inertia": 2e-3, "damping": 0.05, "torque_constant": 0.4, "radius": 0.05}},
    "strings": {
        "s1": {"nodes": ["n3", "n2"], "material": "cable"},
        "s2": {"nodes": ["n4", "n2"], "material": "cable", "actuator": "winch"},
    },
    "prestress": {"tension": {"s2": 25.0}},
}

#: A three-bar prism on moved ground, with a payload, drag, a motor in a top string and gravity aslant; one bar is afloat.
LABORATORY = {
    "extends": "three_bar",
    "name": "laboratory",
    "start": "released",
    "gravity": [1.0, -0.5, -9.0],
    "fixed": ["n1", "n2", "n3", "n7"],
    "moving": ["n1", "n7"],
    "point_masses": {"n4": 0.4, "n1": 0.3, "n7": 0.2, "n9": 0.25, "n8": 0.1, "n6": 0.2},
    "drag": {"n5": 3.0, "n4": 1.5, "n8": 2.0},
    "nodes": {"n7": [0.3, 0.2, 2.0], "n8": [0.5, 0.3, 1.3], "n9": [-0.2, 0.1, 1.5]},
    "actuators": {"winch": {"inertia": 2e-3, "damping": 0.05, "torque_constant": 0.4, "radius": 0.05}},
    "bars": {"b4": {"nodes": ["n8", "n9"], "mass": 0.8}},
    "strings": {
        "s4": {"actuator": "winch"},
        "s7": {"nodes": ["n7", "n8"], "stiffness": 800.0, "damping": 30.0},
        "s8": {"nodes": ["n7", "n9"], "stiffness": 800.0, "damping": 30.0},
        "s9": {"nodes": ["n8", "n4"], "stiffness": 500.0, "damping": 20.0, "actuator": "winch"},
        "s10": {"nodes": ["n9", "n6"], "stiffness": 500.0, "damping": 20.0},
    },
    "prestress": {
        "tension": dict.fromkeys(("s1", "s2", "s3"), 2.0)
        | dict.fromkeys(("s4", "s5", "s6"), 8.0)
        | {"s7": 6.0, "s8": 6.0, "s9": 3.0, "s10": 3.0}
    },
}


#: The same with what its members bear: bars that are pushed and pulled, with sections of every kind, and strings.
RATED = LABORATORY | {
    "name": "rated",
    "materials": {"cable": {"strength": 900.0}},
    "bars": {
        "b1": {"E": 70e9, "diameter": 0.012},
        "b2": {"E": 210e9, "diameter": 0.02, "wall": 0.001},
        "b4": {"nodes": ["n8", "n9"], "mass": 0.8, "E": 3e9, "area": 1.2e-4, "second_moment": 4e-10},
    },
    "strings": LABORATORY["strings"] | {"s7": LABORATORY["strings"]["s7"] | {"strength": 60.0}},
}


def built(scene: dict, **changes):
    """The model of a scene with some of its keys replaced."""
    return build_model(parse_scene(scene | changes))
