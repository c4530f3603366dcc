"""Scenes whose strings run over nodes, have mass or push: for the tests of kernel, reference and FMUs."""

from tests.support.driven_scenes import LABORATORY

#: The laboratory with strings over several nodes besides: over a moved node, an endless one with an NSH, one that a motor
#: winds, one with both ends of a bar on it, one that also pushes; some with mass.
RIGGED = LABORATORY | {
    "name": "rigged",
    "nsh": {"honey": {"Q": [6.0, 8.0], "zeta": [3.0, 5.0], "h": [0.01, 0.015]}},
    "strings": LABORATORY["strings"]
    | {
        "s3": {"mass": 0.15},
        "s11": {"nodes": ["n1", "n6", "n7", "n8", "n5"], "stiffness": 900.0, "damping": 15.0, "mass": 0.2},
        "s12": {"nodes": ["n4", "n9", "n6", "n4"], "stiffness": 3000.0, "damping": 10.0, "nsh": "honey"},
        "s13": {"nodes": ["n2", "n8", "n4"], "stiffness": 120.0, "damping": 12.0, "actuator": "winch"},
        "s14": {"nodes": ["n5", "n9"], "stiffness": 300.0, "damping": 5.0, "two_way": True},
        "s15": {"nodes": ["n7", "n9", "n8", "n6"], "stiffness": 600.0, "damping": 8.0, "two_way": True, "mass": 0.1},
    },
    "prestress": {
        "tension": LABORATORY["prestress"]["tension"] | {"s11": 9.0, "s12": 7.0, "s13": 5.0, "s14": -2.0, "s15": 3.0}
    },
}
