"""The article's claims of its sections III to V, one by one, judged by what this model gives.

Writes docs/claims.json (the measures, see measures.py), docs/claims.md and its figures docs/figures/claims*.png and .svg.  Every claim is
a rule over the measures, so the same rule judges this model and every variant of what the article leaves open.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import machine  # noqa: E402
from article.measures import VARIANTS, measure  # noqa: E402
from matplotlib.colors import ListedColormap  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.patches import Patch  # noqa: E402
from stability.common import new_figure, plain, save, style, table, wrapped  # noqa: E402

from tensegrity_core.experiments import LIFTS  # noqa: E402

YES, PARTLY, NO = "yes", "partly", "no"
SYSTEMS = {"two_bar": "two-bar", "three_bar": "three-bar", "six_bar": "six-bar"}
TITLES = {
    "statics": "Systems and honeycomb (section III)",
    "I": "Experiment I: steady heights",
    "II": "Experiment II: square wave",
    "III": "Experiment III: actuated strings",
    "IV": "Experiment IV: one dimension",
}
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

    def verdict(self, data: dict, variant: str = "base") -> str | None:
        """yes, partly or no; None where the variant could not be run."""
        numbers = self.numbers(data, variant)
        if "failure" in numbers:
            return None
        conditions = self.rule(numbers)
        return YES if all(conditions) else PARTLY if any(conditions) else NO


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
        "statics", "Bars are 1.29 m long in the 2D system and 2.07 m in the 3D ones.", _bar_lengths,
        lambda d: each(lambda name: f"{d['statics']['bar_lengths'][name][0]:.4f} m"), True,
    ),
    Claim(
        "statics", "The given coordinates are in equilibrium.",
        lambda d: [d["statics"]["moved"][name] < 1e-3 for name in SYSTEMS],
        lambda d: "settled start within " + each(lambda name: f"{1e3 * d['statics']['moved'][name]:.1f} mm"), True,
        "Two-bar with one tension left free; three-bar only under gravity, which then determines every tension; the six-bar "
        "tower is near a self-stressed state, not in one.",
    ),
    Claim(
        "statics", "All four beams are metastable (Q = 6, 8, 10, 12 N, \u03b6 = 3, 4, 5, 6).",
        lambda d: [f > 0.0 for f in d["statics"]["f_min"]],
        lambda d: "f_min = " + ", ".join(f"{f:.2f}" for f in d["statics"]["f_min"]) + " N, all positive", True,
    ),
    Claim(
        "statics", "The honeycomb's largest compression is slightly more than 8 cm (figure 5).", _compression,
        lambda d: f"{100 * d['statics']['marks']['snap 4'][0]:.2f} cm where the last beam snaps, "
        f"{100 * d['statics']['after_last_snap']:.2f} cm where it has, {100 * d['statics']['marks']['end'][0]:.2f} cm "
        "at the stops", True,
        "The article's own h give a sum of 2 h of 9 cm.",
    ),
)  # fmt: skip

# --- I -----------------------------------------------------------------------------------------------------------


def nsh(name: str) -> str:
    return name + "_nsh"


def _four_snaps(m: dict) -> list[bool]:
    return [len(steps(m[nsh(name)])) == 4 and all(len(kind) == 4 for kind in m[nsh(name)]["snaps"]) for name in SYSTEMS]


def steps(scene: dict) -> list[tuple[float, float]]:
    """Pairs of neighbouring lifts between which any beam snaps."""
    return sorted({(low, high) for kind in scene["snaps"] for low, high, _ in kind})


def _shown_steps(scene: dict) -> str:
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
        "I", "Lifts of 10 to 72 N snap all four beams.",
        lambda m: [m[nsh(name)]["most_snapped"][0] == 0 and m[nsh(name)]["least_snapped"][1] == 4 for name in SYSTEMS],
        lambda m: "beams snapped at 10 and 72 N: " + each(
            lambda n: f"{m[nsh(n)]['most_snapped'][0]} and {m[nsh(n)]['least_snapped'][1]}"),
    ),
    Claim(
        "I", "There are four snaps in each system's curve.", _four_snaps,
        lambda m: "between " + "; ".join(f"{SYSTEMS[n]} {_shown_steps(m[nsh(n)])} N" for n in SYSTEMS),
        note="The six-bar system has two kinds of NSH strings, vertical and diagonal, and these do not snap together.",
    ),
    Claim(
        "I", "A beam snaps when the force on the NSH passes its f_max.", _tension_at_snaps,
        lambda d: "largest distance of the string's elastic force from f_max just before: "
        f"{max(abs(x['tension'] - f) for x, f in _with_f_max(d)):.4f} N", True,
    ),
    Claim(
        "I", "Snaps occur when the external force is just above f_max (13.3, 20.4, 28.9, 39.1 N).", _lift_at_snaps,
        lambda d: "lifts: " + each(lambda name: _lifts(d, name)), True,
        "What the lift adds to the string's force depends on geometry, weight and prestress.",
    ),
    Claim(
        "I", "All top nodes have the same height.",
        lambda m: [m[name + kind]["spread"] < 1e-3 for name in SYSTEMS for kind in ("", "_nsh")],
        lambda m: "largest difference with NSH: " + each(lambda n: f"{1e3 * m[nsh(n)]['spread']:.2f} mm"),
        note="The given coordinates are three-fold symmetric to a millimetre only; where a snap is near, one string snaps first.",
    ),
    Claim(
        "I", "The vertical strings snap at the same time.",
        lambda m: [m[nsh(name)]["apart"] == 0 for name in SYSTEMS],
        lambda m: "largest difference in snapped beams: " + each(lambda n: str(m[nsh(n)]["apart"])),
    ),
    Claim(
        "I", "Without NSH the curve is smooth and almost linear.",
        lambda m: [m[name]["bend"] <= LINEAR for name in SYSTEMS],
        lambda m: "largest distance from a straight line, of the range: " + each(lambda n: f"{100 * m[n]['bend']:.1f} %"),
        note="The two-bar curve bends where its top string goes slack, the six-bar one as the tower stiffens.",
    ),
    Claim(
        "I", "The range of z is larger with NSH.",
        lambda m: [m[nsh(name)]["range"] > m[name]["range"] for name in SYSTEMS],
        lambda m: "with and without: " + each(lambda n: f"{1e3 * m[nsh(n)]['range']:.1f} and {1e3 * m[n]['range']:.1f} mm"),
    ),
    Claim(
        "I", "With NSH the reachable heights are several domains that do not intersect.",
        lambda d: [x["gap"] > GAP for name in SYSTEMS for x in d["snaps"][name]],
        lambda d: f"smallest and largest gap at a snap: {1e3 * min(_gaps(d)):.1f} and {1e3 * max(_gaps(d)):.1f} mm, between lifts "
        "0.01 N apart", True,
    ),
    Claim(
        "I", "After 50 s the systems are at rest.",
        lambda m: [m[name + kind]["speed"] < AT_REST for name in SYSTEMS for kind in ("", "_nsh")],
        lambda m: "fastest node, with NSH: " + each(lambda n: f"{m[nsh(n)]['speed']:.0e} m/s"),
        note="The six-bar system has motions that change no string's length at first order, so no damper sees them.",
    ),
)  # fmt: skip


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


def _forces(m: dict, name: str) -> tuple[float, float]:
    return m["nsh/500"][name], m["plain/500"][name]


SECOND = (
    Claim("II", "d = 500: n5 moves farther without NSH.", lambda m: _compare(m, ("plain", 500), ("nsh", 500)),
          lambda m: _both(m, 500)),
    Claim("II", "d = 500: the steady response with NSH is more than two times smaller.",
          lambda m: [2.0 * swing(m, "nsh", 500) < swing(m, "plain", 500)],
          lambda m: f"steady swing {swing(m, 'nsh', 500):.2f} m with, {swing(m, 'plain', 500):.2f} m without"),
    Claim("II", "d = 50: n5 moves farther with NSH.", lambda m: _compare(m, ("nsh", 50), ("plain", 50)), lambda m: _both(m, 50)),
    Claim("II", "d = 5000: n5 moves farther without NSH.", lambda m: _compare(m, ("plain", 5000), ("nsh", 5000)),
          lambda m: _both(m, 5000)),
    Claim("II", "n5 moves farther at d = 50 than at d = 500.",
          lambda m: [c for kind in ("nsh", "plain") for c in _compare(m, (kind, 50), (kind, 500))],
          lambda m: "50 and 500, with: " + _moves(m, ("nsh", 50), ("nsh", 500)) + "; without: "
          + _moves(m, ("plain", 50), ("plain", 500))),
    Claim("II", "n5 moves much less at d = 5000 than at d = 500.",
          lambda m: [c for kind in ("nsh", "plain") for c in _compare(m, (kind, 500), (kind, 5000), MUCH)],
          lambda m: "5000 and 500, with: " + _moves(m, ("nsh", 5000), ("nsh", 500)) + "; without: "
          + _moves(m, ("plain", 5000), ("plain", 500))),
    Claim("II", "At high damping the response is periodic after the first period.",
          lambda m: [x <= TRANSIENT for x in _away(m, 5000, 2).values()],
          lambda m: "d = 5000, second period: " + _shown_away(_away(m, 5000, 2)),
          note="With NSH it repeats every second period only, and not yet so within 5 s."),
    Claim("II", "At low damping transients last into the fourth period.",
          lambda m: [x > TRANSIENT for x in _away(m, 50, 4).values()],
          lambda m: "d = 50, fourth period: " + _shown_away(_away(m, 50, 4))),
    Claim("II", "d = 500: elastic forces of n1-n4 are much smaller with NSH.",
          lambda m: [with_nsh <= MUCH * without for with_nsh, without in (_forces(m, "force_peak"), _forces(m, "force_mean"))],
          lambda m: "with and without: peak {:.0f} and {:.0f} N".format(*_forces(m, "force_peak"))
          + ", mean {:.0f} and {:.0f} N".format(*_forces(m, "force_mean")),
          note="Under 400 N the NSH bottoms out, and its string's own stiffness carries the peaks."),
    Claim("II", "d = 500: bars carry less with NSH.", lambda m: [_forces(m, "bar_mean")[0] < _forces(m, "bar_mean")[1]],
          lambda m: "mean over bars and time, with dampers: {:.0f} and {:.0f} N".format(*_forces(m, "bar_mean"))),
    Claim("II", "d = 500: the NSH's snaps show in the string's force.", lambda m: [m["nsh/500"]["snaps"] > 0],
          lambda m: f"{m['nsh/500']['snaps']} beams of n1-n4 snap in 5 s"),
    Claim("II", "NSH increase the absorption of energy (section V).",
          lambda m: [m[f"nsh/{d}"]["dissipated"] > m[f"plain/{d}"]["dissipated"] for d in (50, 500, 5000)],
          lambda m: "dissipated in 10 s, with and without: " + "; ".join(
              f"{m[f'nsh/{d}']['dissipated'] / 1e3:.1f} and {m[f'plain/{d}']['dissipated'] / 1e3:.1f} kJ at d = {d}"
              for d in (50, 500, 5000))),
)  # fmt: skip

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
    Claim("III", "Two-bar: the coordinates change more with NSH.", lambda m: [_larger(m, "two_bar")],
          lambda m: "swing with NSH against without, by axis: " + _swings(m, "two_bar")),
    Claim("III", "Three-bar and six-bar: this cannot be said.",
          lambda m: [not _larger(m, name) for name in ("three_bar", "six_bar")],
          lambda m: each(lambda n: _swings(m, n), ("three_bar", "six_bar"))),
    Claim("III", "The pattern is cyclic, but nonlinear.",
          lambda m: [c for name in m for c in (m[name]["away"] <= 0.1, m[name]["harmonics"] > NONLINEAR)],
          lambda m: f"last period off the one before by up to {100 * max(x['away'] for x in m.values()):.1f} % of the way; "
          f"higher harmonics hold {100 * min(x['harmonics'] for x in m.values()):.1f} to "
          f"{100 * max(x['harmonics'] for x in m.values()):.1f} % of the power"),
    Claim("III", "Six-bar: there are oscillations.",
          lambda m: [max(m[name]["turns"]) > 2 for name in ("six_bar", "six_bar_nsh")],
          lambda m: "turns of a coordinate per period, at most, with NSH: " + each(lambda n: str(max(m[nsh(n)]["turns"])))),
    Claim("III", "Displacements are largest in the three-bar system.",
          lambda m: [m["three_bar" + k]["way"] > m[other + k]["way"] for k in ("", "_nsh") for other in ("two_bar", "six_bar")],
          lambda m: "largest way with NSH: " + each(lambda n: f"{m[nsh(n)]['way']:.3f} m")),
    Claim("III", "NSH make the most difference in the two-bar system.",
          lambda m: [_difference(m, "two_bar") > _difference(m, other) for other in ("three_bar", "six_bar")],
          lambda m: "largest distance of the paths, of the way without: " + each(lambda n: f"{100 * _difference(m, n):.0f} %")),
)  # fmt: skip

# --- IV ----------------------------------------------------------------------------------------------------------

FOURTH = (
    Claim("IV", "More energy is absorbed with NSH.",
          lambda m: [m["nsh"][key] > m["plain"][key] for key in ("absorbed", "first")],
          lambda m: f"{m['nsh']['absorbed']:.1f} J with, {m['plain']['absorbed']:.1f} J without in 4 s; in the first period "
          f"{m['nsh']['first']:.2f} and {m['plain']['first']:.2f} J",
          note="From rest to rest this must be so: the work of a constant force is force times way, and the softer spring goes "
          "farther."),
    Claim("IV", "Figure 10's axis of power ends at 10 (W).",
          lambda m: [7.0 < max(m["nsh"]["power"], m["plain"]["power"]) <= 10.0],
          lambda m: f"largest power {m['nsh']['power']:.1f} W with, {m['plain']['power']:.1f} W without",
          note="The axis' labels are in the text; the curve was not at hand. The power of an overdamped system is about "
          "F\u00b2/d."),
)  # fmt: skip

CLAIMS = (*STATICS, *FIRST, *SECOND, *THIRD, *FOURTH)
NUMBERED = dict(enumerate(CLAIMS, 1))

# --- figure ------------------------------------------------------------------------------------------------------

COLOURS = {NO: "#d1495b", PARTLY: "#edae49", YES: "#1b9aaa", None: "#e6e4de"}
RANKS = {NO: 0, PARTLY: 1, YES: 2, None: 3}


def scanned(experiment: str) -> dict[int, Claim]:
    return {number: claim for number, claim in NUMBERED.items() if claim.experiment == experiment and not claim.whole}


def draw(data: dict) -> Figure:
    """A panel per experiment: a row per variant, a column per claim."""
    rows = [len(variants) for variants in VARIANTS.values()]
    figure = new_figure(8.6, 0.18 * sum(rows) + 1.9)
    panels = figure.subplots(len(rows), 1, height_ratios=rows)
    for axes, (experiment, variants) in zip(panels, VARIANTS.items()):
        claims = scanned(experiment)
        ranks = [[RANKS[claim.verdict(data, variant.key)] for claim in claims.values()] for variant in variants]
        axes.pcolormesh(ranks, cmap=ListedColormap(list(COLOURS.values())), vmin=-0.5, vmax=3.5, edgecolors="white", linewidth=1.5)
        axes.set_xticks([i + 0.5 for i in range(len(claims))], [str(number) for number in claims])
        axes.set_yticks([i + 0.5 for i in range(len(variants))], [variant.about.replace("`", "") for variant in variants])
        axes.tick_params(length=0, labelsize=7.5)
        axes.set_xlim(0, max(len(scanned(e)) for e in VARIANTS))
        axes.invert_yaxis()
        axes.grid(False)
        axes.set_title(f"{TITLES[experiment]}; claims by number")
        axes.spines[:].set_visible(False)
    handles = [Patch(color=COLOURS[verdict], label=verdict) for verdict in (YES, PARTLY, NO)]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, title="reproduced")
    return figure


def draw_sweep(data: dict) -> Figure:
    """Steady swing of n5 and peak force of n1-n4 against the damping, with and without NSH."""
    figure = new_figure(8.6, 3.0)
    panels = figure.subplots(1, 2)
    damping = [float(d) for d in data["sweep"]]
    for kind, line in (("nsh", "-o"), ("plain", "--o")):
        runs = [both[kind] for both in data["sweep"].values()]
        label = "with NSH" if kind == "nsh" else "without NSH"
        panels[0].plot(damping, [run["swing"][3] for run in runs], line, color="#22252e", label=label)
        panels[1].plot(damping, [run["force_peak"] for run in runs], line, color="#22252e", label=label)
    panels[0].set(title="steady swing of n5", ylabel="m", ylim=(0.0, None))
    panels[1].set(title="peak elastic force of n1-n4", ylabel="N", yscale="log")
    for axes in panels:
        axes.set(xscale="log", xlabel="d in N s/m")
        axes.legend()
    return figure


# --- page --------------------------------------------------------------------------------------------------------


def turned(number: int, data: dict) -> str:
    """Variants under which the claim is judged otherwise."""
    claim = NUMBERED[number]
    if claim.whole:
        return ""
    base, found = claim.verdict(data), {YES: [], PARTLY: [], NO: []}
    for variant in VARIANTS[claim.experiment]:
        verdict = claim.verdict(data, variant.key)
        if verdict not in (base, None):
            found[verdict].append(variant.about)
    return ". ".join(f"**{verdict}** with: {'; '.join(names)}" for verdict, names in found.items() if names) or "none"


def claims_table(experiment: str, data: dict) -> str:
    rows = []
    for number, claim in NUMBERED.items():
        if claim.experiment == experiment:
            found = claim.found(claim.numbers(data)) + "." + (f" {claim.note}" if claim.note else "")
            cells = [str(number), claim.says, found, f"**{claim.verdict(data)}**"]
            rows.append(cells if experiment == "statics" else [*cells, turned(number, data)])
    head = ["", "the article", "this model", "reproduced"]
    return table(head if experiment == "statics" else [*head, "otherwise"], rows)


def wave_table(data: dict) -> str:
    """n5's swing and the string's force under every variant of II."""
    rows = []
    for variant in VARIANTS["II"]:
        m = data["II"][variant.key]
        if "failure" in m:
            rows.append([variant.about, *["\u2013"] * 7])
            continue
        swings = [f"{swing(m, 'nsh', d):.2f}, {swing(m, 'plain', d):.2f}" for d in (50, 500, 5000)]
        ways = [f"{way(m, 'nsh', d):.2f}, {way(m, 'plain', d):.2f}" for d in (50, 500, 5000)]
        rows.append([variant.about, *swings, *ways, "{:.0f}, {:.0f}".format(*_forces(m, "force_peak"))])
    head = ["with, without NSH", *(f"swing, m, d = {d}" for d in (50, 500, 5000)), *(f"way, m, d = {d}" for d in (50, 500, 5000))]
    return table([*head, "peak of n1-n4, N, d = 500"], rows)


def tally(data: dict) -> str:
    counts = {verdict: sum(claim.verdict(data) == verdict for claim in CLAIMS) for verdict in (YES, PARTLY, NO)}
    return f"Of {len(CLAIMS)} claims {counts[YES]} are reproduced, {counts[PARTLY]} partly, and {counts[NO]} not."


def wave_text(data: dict) -> str:
    """What moves n5."""
    rise = data["rise"]
    return (
        "Forces of this size throw the three-bar system between two shapes: without load it stands at "
        f"{rise['start']:.3f} m, and {rise['lift']:.1f} N on each top node are enough to lift it by {rise['gap']:.2f} m into the "
        "other one. n5's displacement is mostly this change of shape, with NSH and without. The choices of the first figure in "
        "numbers:"
    )


def sweep_text(data: dict) -> str:
    """What the scan says of the claims that are farthest off, and at which damping they come nearer."""
    runs = [m for m in data["II"].values() if "failure" not in m]
    ratios = [swing(m, "nsh", 500) / swing(m, "plain", 500) for m in runs]
    less = [f"{float(d):g}" for d, both in data["sweep"].items() if both["nsh"]["swing"][3] < both["plain"]["swing"][3]]
    weak = [f"{float(d):g}" for d, both in data["sweep"].items() if both["nsh"]["force_peak"] <= MUCH * both["plain"]["force_peak"]]
    heavy = [str(n) for n, claim in scanned("II").items() if (claim.verdict(data), claim.verdict(data, "d_times_10")) == (NO, YES)]
    return (
        f"n5's steady swing at d = 500 with NSH is {min(ratios):.2f} to {max(ratios):.2f} times that without, over all "
        f"{len(ratios)} choices; " + ("none halves it. " if min(ratios) >= 0.5 else "some halve it. ") + "Damping changes most: of "
        f"the dampings below, the swing is smaller with NSH at d = {', '.join(less)} N s/m, and the peak force of n1-n4 at most "
        f"half as large at d = {', '.join(weak)} N s/m. With every d ten times as large, claims that are not reproduced come out: "
        f"{', '.join(heavy) or 'none'}."
    )


WORDS = (
    f"'Almost linear': within {100 * LINEAR:.0f} % of the range. 'Just above': by up to {100 * SLIGHTLY:.0f} %. 'Much less': at most "
    f"half. 'Larger' of a coordinate's swing: by {100 * (LARGER - 1):.0f} % in every coordinate. A transient: more than "
    f"{100 * TRANSIENT:.0f} % of the swing. 'Cyclic': successive periods within 10 % of the way; 'nonlinear': more than "
    f"{100 * NONLINEAR:.1f} % of the power in higher harmonics. At rest: below {AT_REST:g} m/s. Domains: gaps of more than "
    f"{1e3 * GAP:.0f} mm. n5 moves farther: in its largest distance from the start within 5 s, and in its steady swing (the norm "
    "of the three coordinates' swings over the ninth and tenth period)."
)


def report(data: dict) -> str:
    """docs/claims.md."""
    where = data["machine"]
    blocks = [
        "# The article's claims",
        "What sections III to V of the article say of its four experiments, and what this model gives: the article's equations with "
        "the corrected moment of inertia (J = m/12 in M), the exact NSH law, and transitions located. "
        "[experiments.md](experiments.md) has the figures; the article's own curves were not at hand to be laid over, only its "
        "text. " + tally(data),
        "Each claim is a rule over measured numbers, *partly* where some of its conditions hold. The article's words are taken to "
        "mean: " + WORDS,
        "The article leaves open: the prestress of the two-bar and the six-bar system, what a damper does while its string shortens, "
        "what follows beyond the NSH's end at 9 cm, whether an NSH string keeps its damper, the wave's sign and phase, gravity of "
        f"the 3D systems, and all numbers of experiment IV. The NSH's law stays the article's, single-valued. The last column says which other choice changes a verdict; lifts are "
        f"the article's, {LIFTS[0]} to {LIFTS[-1]} N in steps of {LIFTS[1] - LIFTS[0]} N.",
        "![Verdicts under every choice](figures/claims.png)",
    ]
    for experiment, title in TITLES.items():
        blocks += [f"## {title}", claims_table(experiment, data)]
        if experiment == "II":
            blocks += [wave_text(data), wave_table(data), sweep_text(data)]
            blocks.append("![Swing and string force against the damping](figures/claims_damping.png)")
    blocks.append(
        f"Measured at commit {where['commit']}, {where['date']}, {where['processor']}, in {data['seconds']:.0f} s; the numbers stand "
        "in [claims.json](claims.json). Written by `python benchmarks/article/claims.py`; `--redraw` writes the page and the figure "
        "again from that file ([SVG](figures/claims.svg))."
    )
    return wrapped("\n\n".join(blocks)) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--redraw", action="store_true", help="write page and figure again from claims.json, without measuring")
    options = parser.parse_args()
    path = options.output / "claims.json"
    if options.redraw:
        data = json.loads(path.read_text(encoding="utf-8"))
    else:
        began, where = time.perf_counter(), machine.describe()
        data = plain({"machine": where, **measure(), "seconds": time.perf_counter() - began}, 6)
        options.output.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(data, separators=(",", ":")).replace('},"', '},\n"') + "\n", encoding="utf-8")
    with style():
        save(draw(data), options.output / "figures" / "claims")
        save(draw_sweep(data), options.output / "figures" / "claims_damping")
    (options.output / "claims.md").write_text(report(data), encoding="utf-8")
    print(tally(data))


if __name__ == "__main__":
    main()
