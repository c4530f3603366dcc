"""The article's claims of its sections III to V, one by one: what it says, and the rule by which numbers decide.

The numbers are those of measures.py, so that the same rule judges this model and every variant of what the article leaves
open (variants.py).  claims_page.py measures, judges and writes docs/claims.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

YES, PARTLY, NO = "yes", "partly", "no"
SYSTEMS = {"two_bar": "two-bar", "three_bar": "three-bar", "six_bar": "six-bar"}
#: What words of the article are taken to mean.
LINEAR, SLIGHTLY, MUCH, LARGER, TRANSIENT, NONLINEAR, AT_REST, GAP = 0.05, 0.25, 0.5, 1.05, 0.01, 0.005, 1e-4, 1e-3


@dataclass(frozen=True)
class Claim:
    """says: the article's statement, in short; rule(numbers) -> conditions, all of which must hold; found(numbers) -> text;
    whole: the rule takes all data, of the base model, and is not scanned; note: what else there is to say."""

    experiment: str
    says: str
    rule: Callable[[dict], list[bool]]
    found: Callable[[dict], str]
    whole: bool = False
    note: str = ""

    def numbers(self, data: dict, variant: str = "base") -> dict:
        return data if self.whole else data[self.experiment][variant]

    def share(self, data: dict, variant: str = "base") -> float | None:
        """Of the conditions, how many hold, 0 to 1; None where the variant could not be run."""
        numbers = self.numbers(data, variant)
        if "failure" in numbers:
            return None
        conditions = self.rule(numbers)
        return sum(conditions) / len(conditions)

    def verdict(self, data: dict, variant: str = "base") -> str | None:
        """yes, partly or no; None where the variant could not be run."""
        share = self.share(data, variant)
        return None if share is None else {0.0: NO, 1.0: YES}.get(share, PARTLY)


def each(text: Callable[[str], str], names=SYSTEMS) -> str:
    """'two-bar ..., three-bar ...'."""
    return ", ".join(f"{SYSTEMS[name]} {text(name)}" for name in names)


# --- statics -----------------------------------------------------------------------------------------------------


def _bar_lengths(d: dict) -> list[bool]:
    wanted = {"two_bar": 1.29, "three_bar": 2.07, "six_bar": 2.07}
    return [abs(x - wanted[name]) < 0.005 for name in SYSTEMS for x in d["statics"]["bar_lengths"][name]]


def _compression(d: dict) -> list[bool]:
    return [0.08 < d["statics"]["marks"]["end"][0] < 0.085]


STATICS = (
    Claim(
        "statics",
        "Bars are 1.29 m long in the 2D system and 2.07 m in the 3D ones.",
        _bar_lengths,
        lambda d: each(lambda name: f"{d['statics']['bar_lengths'][name][0]:.4f} m"),
        True,
    ),
    Claim(
        "statics",
        "The given coordinates are in equilibrium.",
        lambda d: [d["statics"]["moved"][name] < 1e-3 for name in SYSTEMS],
        lambda d: "settled start within " + each(lambda name: f"{1e3 * d['statics']['moved'][name]:.1f} mm"),
        True,
        "Two-bar with one tension left free; three-bar only under gravity, which then determines every tension; the six-bar "
        "tower is near a self-stressed state, not in one.",
    ),
    Claim(
        "statics",
        "All four beams are metastable (Q = 6, 8, 10, 12 N, \u03b6 = 3, 4, 5, 6).",
        lambda d: [f > 0.0 for f in d["statics"]["f_min"]],
        lambda d: "f_min = " + ", ".join(f"{f:.2f}" for f in d["statics"]["f_min"]) + " N, all positive",
        True,
    ),
    Claim(
        "statics",
        "The honeycomb's largest compression is slightly more than 8 cm (figure 5).",
        _compression,
        lambda d: (
            f"{100 * d['statics']['marks']['snap 4'][0]:.2f} cm where the last beam snaps, "
            f"{100 * d['statics']['after_last_snap']:.2f} cm where it has, {100 * d['statics']['marks']['end'][0]:.2f} cm "
            "at the stops"
        ),
        True,
        "The article's own h give a sum of 2 h of 9 cm.",
    ),
)

# --- I -----------------------------------------------------------------------------------------------------------


def nsh(name: str) -> str:
    return name + "_nsh"


def _four_snaps(m: dict) -> list[bool]:
    return [len(steps(m[nsh(name)])) == 4 and all(len(kind) == 4 for kind in m[nsh(name)]["snaps"]) for name in SYSTEMS]


def steps(scene: dict) -> list[tuple[float, float]]:
    """Pairs of neighbouring lifts between which any beam snaps."""
    return sorted({(low, high) for kind in scene["snaps"] for low, high, _ in kind})


def shown_steps(scene: dict) -> str:
    """'20-22, 28-30'."""
    return ", ".join(f"{low:g}\u2013{high:g}" for low, high in steps(scene)) or "none"


def _tension_at_snaps(d: dict) -> list[bool]:
    return [abs(x["tension"] - f) < 0.02 for x, f in _with_f_max(d)]


def _lift_at_snaps(d: dict) -> list[bool]:
    return [f < x["lift"] <= (1.0 + SLIGHTLY) * f for x, f in _with_f_max(d)]


def _with_f_max(d: dict):
    return [(x, d["statics"]["f_max"][x["beam"] - 1]) for name in SYSTEMS for x in d["snaps"][name]]


def _lifts(d: dict, name: str) -> str:
    kinds = sorted({x["kind"] for x in d["snaps"][name]})
    found = [", ".join(f"{x['lift']:.1f}" for x in d["snaps"][name] if x["kind"] == kind) for kind in kinds]
    return " and ".join(found) + " N"


FIRST = (
    Claim(
        "I",
        "Lifts of 10 to 72 N snap all four beams.",
        lambda m: [m[nsh(name)]["most_snapped"][0] == 0 and m[nsh(name)]["least_snapped"][1] == 4 for name in SYSTEMS],
        lambda m: (
            "beams snapped at 10 and 72 N: "
            + each(lambda n: f"{m[nsh(n)]['most_snapped'][0]} and {m[nsh(n)]['least_snapped'][1]}")
        ),
    ),
    Claim(
        "I",
        "There are four snaps in each system's curve.",
        _four_snaps,
        lambda m: "between " + "; ".join(f"{SYSTEMS[n]} {shown_steps(m[nsh(n)])} N" for n in SYSTEMS),
        note="The six-bar system has two kinds of NSH strings, vertical and diagonal, and these do not snap together.",
    ),
    Claim(
        "I",
        "A beam snaps when the force on the NSH passes its f_max.",
        _tension_at_snaps,
        lambda d: (
            "largest distance of the string's elastic force from f_max just before: "
            f"{max(abs(x['tension'] - f) for x, f in _with_f_max(d)):.4f} N"
        ),
        True,
    ),
    Claim(
        "I",
        "Snaps occur when the external force is just above f_max (13.3, 20.4, 28.9, 39.1 N).",
        _lift_at_snaps,
        lambda d: "lifts: " + each(lambda name: _lifts(d, name)),
        True,
        "What the lift adds to the string's force depends on geometry, weight and prestress.",
    ),
    Claim(
        "I",
        "All top nodes have the same height.",
        lambda m: [m[name + kind]["spread"] < 1e-3 for name in SYSTEMS for kind in ("", "_nsh")],
        lambda m: "largest difference with NSH: " + each(lambda n: f"{1e3 * m[nsh(n)]['spread']:.2f} mm"),
        note="The given coordinates are symmetric to a millimetre only; where a snap is near, one string snaps first.",
    ),
    Claim(
        "I",
        "The vertical strings snap at the same time.",
        lambda m: [m[nsh(name)]["apart"] == 0 for name in SYSTEMS],
        lambda m: "largest difference in snapped beams: " + each(lambda n: str(m[nsh(n)]["apart"])),
    ),
    Claim(
        "I",
        "Without NSH the curve is smooth and almost linear.",
        lambda m: [m[name]["bend"] <= LINEAR for name in SYSTEMS],
        lambda m: "largest distance from a straight line, of the range: " + each(lambda n: f"{100 * m[n]['bend']:.1f} %"),
        note="The two-bar curve bends where its top string goes slack, the six-bar one as the tower stiffens.",
    ),
    Claim(
        "I",
        "The range of z is larger with NSH.",
        lambda m: [m[nsh(name)]["range"] > m[name]["range"] for name in SYSTEMS],
        lambda m: "with and without: " + each(lambda n: f"{1e3 * m[nsh(n)]['range']:.1f} and {1e3 * m[n]['range']:.1f} mm"),
    ),
    Claim(
        "I",
        "Under the same force the systems give way more with NSH.",
        lambda m: [a > b for name in SYSTEMS for a, b in zip(m[nsh(name)]["z"], m[name]["z"])],
        lambda m: (
            "height gained with NSH over that without, from the least to the largest of all lifts: "
            + each(lambda n: "{:.1f} to {:.1f} mm".format(*_gained(m, n)))
        ),
    ),
    Claim(
        "I",
        "With NSH the reachable heights are several domains that do not intersect.",
        lambda d: [x["gap"] > GAP for name in SYSTEMS for x in d["snaps"][name]],
        lambda d: (
            f"smallest and largest gap at a snap: {1e3 * min(_gaps(d)):.1f} and {1e3 * max(_gaps(d)):.1f} mm, between "
            "lifts 0.01 N apart"
        ),
        True,
    ),
    Claim(
        "I",
        "After 50 s the systems are at rest.",
        lambda m: [m[name + kind]["speed"] < AT_REST for name in SYSTEMS for kind in ("", "_nsh")],
        lambda m: "fastest node: " + each(lambda n: f"{max(m[n]['speed'], m[nsh(n)]['speed']):.0e} m/s"),
        note="The six-bar system has motions that change no string's length at first order, so no damper sees them.",
    ),
)


def _gained(m: dict, name: str) -> tuple[float, float]:
    """mm: least and largest difference of the heights with and without NSH."""
    gained = [1e3 * (a - b) for a, b in zip(m[nsh(name)]["z"], m[name]["z"])]
    return min(gained), max(gained)


def _gaps(d: dict) -> list[float]:
    return [x["gap"] for name in SYSTEMS for x in d["snaps"][name]]


# --- II ----------------------------------------------------------------------------------------------------------


def way(m: dict, kind: str, damping: int) -> float:
    return m[f"{kind}/{damping}"]["way"]


def swing(m: dict, kind: str, damping: int) -> float:
    return m[f"{kind}/{damping}"]["swing"][3]


def _compare(m: dict, larger: tuple[str, int], smaller: tuple[str, int], factor: float = 1.0) -> list[bool]:
    """Whether factor times the first is larger than the second, in the largest way and in the steady swing."""
    return [factor * measured(m, *larger) > measured(m, *smaller) for measured in (way, swing)]


def _moves_of_both(m: dict, one: int, other: int) -> str:
    with_it, without = (_moves(m, (kind, one), (kind, other)) for kind in ("nsh", "plain"))
    return f"{one} and {other}, with: {with_it}; without: {without}"


def _moves(m: dict, *cases: tuple[str, int]) -> str:
    """'largest way 0.8, 0.9 m; steady swing 1.0, 1.1 m'."""
    ways, swings = (", ".join(f"{measured(m, *case):.2f}" for case in cases) for measured in (way, swing))
    return f"largest way {ways} m; steady swing {swings} m"


def _both(m: dict, damping: int) -> str:
    return "with and without: " + _moves(m, ("nsh", damping), ("plain", damping))


def _away(m: dict, damping: int, period: int) -> dict[str, float]:
    return {kind: m[f"{kind}/{damping}"]["away"][period - 1] for kind in ("nsh", "plain")}


def _shown_away(found: dict[str, float]) -> str:
    return f"off the last period by {100 * found['nsh']:.1f} % of the swing with NSH, {100 * found['plain']:.1f} % without"


def forces(m: dict, name: str) -> tuple[float, float]:
    return m["nsh/500"][name], m["plain/500"][name]


SECOND = (
    Claim(
        "II",
        "d = 500: n5 moves farther without NSH.",
        lambda m: _compare(m, ("plain", 500), ("nsh", 500)),
        lambda m: _both(m, 500),
    ),
    Claim(
        "II",
        "d = 500: the steady response with NSH is more than two times smaller.",
        lambda m: [2.0 * swing(m, "nsh", 500) < swing(m, "plain", 500)],
        lambda m: f"steady swing {swing(m, 'nsh', 500):.2f} m with, {swing(m, 'plain', 500):.2f} m without",
    ),
    Claim(
        "II", "d = 50: n5 moves farther with NSH.", lambda m: _compare(m, ("nsh", 50), ("plain", 50)), lambda m: _both(m, 50)
    ),
    Claim(
        "II",
        "d = 5000: n5 moves farther without NSH.",
        lambda m: _compare(m, ("plain", 5000), ("nsh", 5000)),
        lambda m: _both(m, 5000),
    ),
    Claim(
        "II",
        "n5 moves farther at d = 50 than at d = 500.",
        lambda m: [c for kind in ("nsh", "plain") for c in _compare(m, (kind, 50), (kind, 500))],
        lambda m: _moves_of_both(m, 50, 500),
    ),
    Claim(
        "II",
        "n5 moves much less at d = 5000 than at d = 500.",
        lambda m: [c for kind in ("nsh", "plain") for c in _compare(m, (kind, 500), (kind, 5000), MUCH)],
        lambda m: _moves_of_both(m, 5000, 500),
    ),
    Claim(
        "II",
        "At high damping the response is periodic after the first period.",
        lambda m: [x <= TRANSIENT for x in _away(m, 5000, 2).values()],
        lambda m: (
            "d = 5000, second period: "
            + _shown_away(_away(m, 5000, 2))
            + "; with NSH all periods but the last: "
            + ", ".join(f"{100 * x:.0f}" for x in m["nsh/5000"]["away"])
            + " %"
        ),
    ),
    Claim(
        "II",
        "At low damping transients last into the fourth period.",
        lambda m: [x > TRANSIENT for x in _away(m, 50, 4).values()],
        lambda m: "d = 50, fourth period: " + _shown_away(_away(m, 50, 4)),
    ),
    Claim(
        "II",
        "d = 500: elastic forces of n1-n4 are much smaller with NSH.",
        lambda m: [with_nsh <= MUCH * without for with_nsh, without in (forces(m, "force_peak"), forces(m, "force_mean"))],
        lambda m: (
            "with and without: peak {:.0f} and {:.0f} N".format(*forces(m, "force_peak"))
            + ", mean {:.0f} and {:.0f} N".format(*forces(m, "force_mean"))
        ),
        note="Under 400 N the NSH bottoms out, and its string's own stiffness carries the peaks.",
    ),
    Claim(
        "II",
        "d = 500: bars carry less with NSH.",
        lambda m: [forces(m, "bar_mean")[0] < forces(m, "bar_mean")[1]],
        lambda m: "mean over bars and time, with dampers: {:.0f} and {:.0f} N".format(*forces(m, "bar_mean")),
    ),
    Claim(
        "II",
        "d = 500: the NSH's snaps show in the string's force.",
        lambda m: [m["nsh/500"]["snaps"] > 0],
        lambda m: f"{m['nsh/500']['snaps']} beams of n1-n4 snap in 5 s",
    ),
    Claim(
        "II",
        "NSH increase the absorption of energy (section V).",
        lambda m: [m[f"nsh/{d}"]["dissipated"] > m[f"plain/{d}"]["dissipated"] for d in (50, 500, 5000)],
        lambda m: (
            "dissipated in 10 s, with and without: "
            + "; ".join(
                f"{m[f'nsh/{d}']['dissipated'] / 1e3:.1f} and {m[f'plain/{d}']['dissipated'] / 1e3:.1f} kJ at d = {d}"
                for d in (50, 500, 5000)
            )
        ),
    ),
)

# --- III ---------------------------------------------------------------------------------------------------------


def _larger(m: dict, name: str) -> bool:
    """Whether every coordinate swings clearly more with NSH."""
    return all(a > LARGER * b for a, b in zip(m[nsh(name)]["swing"], m[name]["swing"]))


def _swings(m: dict, name: str) -> str:
    return " / ".join(f"{100 * (a / b - 1):+.0f} %" for a, b in zip(m[nsh(name)]["swing"], m[name]["swing"]))


def _difference(m: dict, name: str) -> float:
    """Largest distance between the paths with and without NSH, over the largest way without."""
    return m[name]["apart"] / m[name]["way"]


THIRD = (
    Claim(
        "III",
        "Two-bar: the coordinates change more with NSH.",
        lambda m: [_larger(m, "two_bar")],
        lambda m: "swing with NSH against without, by axis: " + _swings(m, "two_bar"),
    ),
    Claim(
        "III",
        "Three-bar and six-bar: this cannot be said.",
        lambda m: [not _larger(m, name) for name in ("three_bar", "six_bar")],
        lambda m: each(lambda n: _swings(m, n), ("three_bar", "six_bar")),
    ),
    Claim(
        "III",
        "The pattern is cyclic, but nonlinear.",
        lambda m: [c for name in m for c in (m[name]["away"] <= 0.1, m[name]["harmonics"] > NONLINEAR)],
        lambda m: (
            f"last period off the one before by up to {100 * max(x['away'] for x in m.values()):.1f} % of the way; "
            f"higher harmonics hold {100 * min(x['harmonics'] for x in m.values()):.1f} to "
            f"{100 * max(x['harmonics'] for x in m.values()):.1f} % of the power"
        ),
    ),
    Claim(
        "III",
        "Six-bar: there are oscillations.",
        lambda m: [max(m[name]["turns"]) > 2 for name in ("six_bar", "six_bar_nsh")],
        lambda m: "turns of a coordinate per period, at most, with NSH: " + each(lambda n: str(max(m[nsh(n)]["turns"]))),
    ),
    Claim(
        "III",
        "Displacements are largest in the three-bar system.",
        lambda m: [m["three_bar" + k]["way"] > m[other + k]["way"] for k in ("", "_nsh") for other in ("two_bar", "six_bar")],
        lambda m: "largest way with NSH: " + each(lambda n: f"{m[nsh(n)]['way']:.3f} m"),
    ),
    Claim(
        "III",
        "NSH make the most difference in the two-bar system.",
        lambda m: [_difference(m, "two_bar") > _difference(m, other) for other in ("three_bar", "six_bar")],
        lambda m: "largest distance of the paths, of the way without: " + each(lambda n: f"{100 * _difference(m, n):.0f} %"),
    ),
)

# --- IV ----------------------------------------------------------------------------------------------------------


def _by_period(m: dict) -> str:
    """'in the first period 8.1 and 2.0 J, in the later ones 3.0 and 2.0 J on average (with NSH ...)'."""
    first, later = (
        [f"{x:.2f}" for x in (pick(m[kind]["periods"]) for kind in ("nsh", "plain"))]
        for pick in (lambda periods: periods[0], lambda periods: sum(periods[1:]) / len(periods[1:]))
    )
    each_later = ", ".join(f"{x:.2f}" for x in m["nsh"]["periods"][1:])
    return (
        f"in the first period {' and '.join(first)} J, in the later ones {' and '.join(later)} J on average "
        f"(with NSH {each_later} J)"
    )


FOURTH = (
    Claim(
        "IV",
        "More energy is absorbed with NSH.",
        lambda m: [m["nsh"]["absorbed"] > m["plain"]["absorbed"], m["nsh"]["periods"][0] > m["plain"]["periods"][0]],
        lambda m: (
            f"{m['nsh']['absorbed']:.1f} J with, {m['plain']['absorbed']:.1f} J without in 4 s; "
            + _by_period(m)
            + f"; the mass ends at {1e3 * m['nsh']['end']:.1f} and {1e3 * m['plain']['end']:.1f} mm, with "
            f"{m['nsh']['stored']:.2f} and {m['plain']['stored']:.2f} J stored"
        ),
        note="The work of a constant force is force times way, and the softer spring goes farther: that decides the first "
        "period, the only one that starts from rest. While there is no force the NSH does not come back, and what it still "
        "holds is not dissipated.",
    ),
    Claim(
        "IV",
        "Figure 10's axis of power ends at 10 (W).",
        lambda m: [7.0 < max(m["nsh"]["power"], m["plain"]["power"]) <= 10.0],
        lambda m: f"largest power {m['nsh']['power']:.1f} W with, {m['plain']['power']:.1f} W without",
        note="The label is read from the article's text, the curve was not at hand. An overdamped system's power is about "
        "F\u00b2/d at most.",
    ),
)

CLAIMS = (*STATICS, *FIRST, *SECOND, *THIRD, *FOURTH)
NUMBERED = dict(enumerate(CLAIMS, 1))
