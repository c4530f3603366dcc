"""The article's claims of its sections III to V, one by one: what it says, and the rule by which numbers decide.

The numbers are those of measures.py, so that the same rule judges this model and every variant of what the article leaves
open (variants.py).  claims_page.py measures, judges and writes docs/claims.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from tensegrity_core.article.figures import TITLES as SYSTEMS

YES, PARTLY, NO = "yes", "partly", "no"
#: What words of the article are taken to mean.
LINEAR, SLIGHTLY, MUCH, LARGER, TRANSIENT, NONLINEAR, AT_REST, GAP = 0.05, 0.25, 0.5, 1.05, 0.01, 0.005, 1e-4, 1e-3
#: With NSH and without.
KINDS = ("nsh", "plain")


@dataclass(frozen=True)
class Claim:
    """says: the article's statement, in short; rule(numbers) -> conditions, all of which must hold, and what is found in words;
    whole: the rule takes all data, of the base model, and is not scanned; note: what else there is to say."""

    experiment: str
    says: str
    rule: Callable[[dict], tuple[list[bool], str]]
    whole: bool = False
    note: str = ""

    def numbers(self, data: dict, variant: str = "base") -> dict:
        return data if self.whole else data[self.experiment][variant]

    def found(self, numbers: dict) -> str:
        return self.rule(numbers)[1]

    def share(self, data: dict, variant: str = "base") -> float | None:
        """Of the conditions, how many hold, 0 to 1; None where the variant could not be run."""
        numbers = self.numbers(data, variant)
        if "failure" in numbers:
            return None
        conditions, _ = self.rule(numbers)
        return sum(conditions) / len(conditions)

    def verdict(self, data: dict, variant: str = "base") -> str | None:
        """yes, partly or no; None where the variant could not be run."""
        share = self.share(data, variant)
        return None if share is None else {0.0: NO, 1.0: YES}.get(share, PARTLY)


#: In the article's order, as the decorator finds them.
CLAIMS: list[Claim] = []


def claim(experiment: str, says: str, note: str = "", whole: bool = False):
    """Adds a claim with the decorated rule."""

    def add(rule):
        CLAIMS.append(Claim(experiment, says, rule, whole, note))
        return rule

    return add


def each(text: Callable[[str], str], names: Iterable[str] = SYSTEMS) -> str:
    """'two-bar ..., three-bar ...'."""
    return ", ".join(f"{SYSTEMS[name]} {text(name)}" for name in names)


def pairs(m: dict, *names: str) -> dict[str, tuple[dict, dict]]:
    """System -> its numbers with NSH and without."""
    return {name: (m[f"{name}_nsh"], m[name]) for name in names or SYSTEMS}


# --- statics -----------------------------------------------------------------------------------------------------


@claim("statics", "Bars are 1.29 m long in the 2D system and 2.07 m in the 3D ones.", whole=True)
def _bars(d):
    wanted, lengths = {"two_bar": 1.29, "three_bar": 2.07, "six_bar": 2.07}, d["statics"]["bar_lengths"]
    return [abs(x - wanted[n]) < 0.005 for n in SYSTEMS for x in lengths[n]], each(lambda n: f"{lengths[n][0]:.4f} m")


@claim(
    "statics",
    "The given coordinates are in equilibrium.",
    "Two-bar with one tension left free; three-bar only under gravity, which then determines every tension; the six-bar tower "
    "is near a self-stressed state, not in one.",
    whole=True,
)
def _equilibrium(d):
    moved = d["statics"]["moved"]
    return [moved[n] < 1e-3 for n in SYSTEMS], "settled start within " + each(lambda n: f"{1e3 * moved[n]:.1f} mm")


@claim("statics", "All four beams are metastable (Q = 6, 8, 10, 12 N, \u03b6 = 3, 4, 5, 6).", whole=True)
def _metastable(d):
    f_min = d["statics"]["f_min"]
    return [f > 0.0 for f in f_min], f"f_min = {', '.join(f'{f:.2f}' for f in f_min)} N, all positive"


@claim(
    "statics",
    "The honeycomb's largest compression is slightly more than 8 cm (figure 5).",
    "The article's own h give a sum of 2 h of 9 cm.",
    whole=True,
)
def _compression(d):
    (snap, _), (end, _) = (d["statics"]["marks"][name] for name in ("snap 4", "end"))
    return [0.08 < end < 0.085], (
        f"{100 * snap:.2f} cm where the last beam snaps, {100 * d['statics']['after_last_snap']:.2f} cm where it has, "
        f"{100 * end:.2f} cm at the stops"
    )


# --- I -----------------------------------------------------------------------------------------------------------


def steps(scene: dict) -> list[tuple[float, float]]:
    """Pairs of neighbouring lifts between which any beam snaps."""
    return sorted({(low, high) for kind in scene["snaps"] for low, high, _ in kind})


def shown_steps(scene: dict) -> str:
    """'20-22, 28-30'."""
    return ", ".join(f"{low:g}\u2013{high:g}" for low, high in steps(scene)) or "none"


def _snaps(d: dict) -> list[tuple[dict, float]]:
    """Every snap that was located, and f_max of its beam, N."""
    return [(x, d["statics"]["f_max"][x["beam"] - 1]) for name in SYSTEMS for x in d["snaps"][name]]


@claim("I", "Lifts of 10 to 72 N snap all four beams.")
def _all_snap(m):
    ends = {n: (nsh["most_snapped"][0], nsh["least_snapped"][1]) for n, (nsh, _) in pairs(m).items()}
    return [x == (0, 4) for x in ends.values()], "beams snapped at 10 and 72 N: " + each(lambda n: "{} and {}".format(*ends[n]))


@claim(
    "I",
    "There are four snaps in each system's curve.",
    "The six-bar system has two kinds of NSH strings, vertical and diagonal, and these do not snap together.",
)
def _four_snaps(m):
    found = {n: nsh for n, (nsh, _) in pairs(m).items()}
    holds = [len(steps(nsh)) == 4 and all(len(kind) == 4 for kind in nsh["snaps"]) for nsh in found.values()]
    return holds, "between " + "; ".join(f"{SYSTEMS[n]} {shown_steps(nsh)} N" for n, nsh in found.items())


@claim("I", "A beam snaps when the force on the NSH passes its f_max.", whole=True)
def _tension_at_snaps(d):
    off = [abs(x["tension"] - f) for x, f in _snaps(d)]
    return [x < 0.02 for x in off], f"largest distance of the string's elastic force from f_max just before: {max(off):.4f} N"


@claim(
    "I",
    "Snaps occur when the external force is just above f_max (13.3, 20.4, 28.9, 39.1 N).",
    "What the lift adds to the string's force depends on geometry, weight and prestress.",
    whole=True,
)
def _lift_at_snaps(d):
    def lifts(name):
        kinds = sorted({x["kind"] for x in d["snaps"][name]})
        found = [", ".join(f"{x['lift']:.1f}" for x in d["snaps"][name] if x["kind"] == kind) for kind in kinds]
        return " and ".join(found) + " N"

    return [f < x["lift"] <= (1.0 + SLIGHTLY) * f for x, f in _snaps(d)], "lifts: " + each(lifts)


@claim(
    "I",
    "All top nodes have the same height.",
    "The given coordinates are symmetric to a millimetre only; where a snap is near, one string snaps first.",
)
def _same_height(m):
    spread = {n: [one["spread"] for one in both] for n, both in pairs(m).items()}
    holds = [x < 1e-3 for both in spread.values() for x in both]
    return holds, "largest difference with NSH: " + each(lambda n: f"{1e3 * spread[n][0]:.2f} mm")


@claim("I", "The vertical strings snap at the same time.")
def _same_time(m):
    apart = {n: nsh["apart"] for n, (nsh, _) in pairs(m).items()}
    return [x == 0 for x in apart.values()], "largest difference in snapped beams: " + each(lambda n: str(apart[n]))


@claim(
    "I",
    "Without NSH the curve is smooth and almost linear.",
    "The two-bar curve bends where its top string goes slack, the six-bar one as the tower stiffens.",
)
def _linear(m):
    text = "largest distance from a straight line, of the range: " + each(lambda n: f"{100 * m[n]['bend']:.1f} %")
    return [m[n]["bend"] <= LINEAR for n in SYSTEMS], text


@claim("I", "The range of z is larger with NSH.")
def _larger_range(m):
    ranges = {n: [one["range"] for one in both] for n, both in pairs(m).items()}
    text = "with and without: " + each(lambda n: "{:.1f} and {:.1f} mm".format(*(1e3 * x for x in ranges[n])))
    return [a > b for a, b in ranges.values()], text


@claim("I", "Under the same force the systems give way more with NSH.")
def _give_way(m):
    gained = {n: [1e3 * (a - b) for a, b in zip(nsh["z"], bare["z"])] for n, (nsh, bare) in pairs(m).items()}
    return [x > 0.0 for gains in gained.values() for x in gains], (
        "height gained with NSH over that without, from the least to the largest of all lifts: "
        + each(lambda n: f"{min(gained[n]):.1f} to {max(gained[n]):.1f} mm")
    )


@claim("I", "With NSH the reachable heights are several domains that do not intersect.", whole=True)
def _domains(d):
    gaps = [x["gap"] for x, _ in _snaps(d)]
    shown = f"{1e3 * min(gaps):.1f} and {1e3 * max(gaps):.1f} mm"
    return [gap > GAP for gap in gaps], f"smallest and largest gap at a snap: {shown}, between lifts 0.01 N apart"


@claim(
    "I",
    "After 50 s the systems are at rest.",
    "The six-bar system has motions that change no string's length at first order, so no damper sees them.",
)
def _at_rest(m):
    speeds = {n: [one["speed"] for one in both] for n, both in pairs(m).items()}
    holds = [x < AT_REST for both in speeds.values() for x in both]
    return holds, "fastest node: " + each(lambda n: f"{max(speeds[n]):.0e} m/s")


# --- II ----------------------------------------------------------------------------------------------------------


def way(m: dict, kind: str, damping: int) -> float:
    return m[f"{kind}/{damping}"]["way"]


def swing(m: dict, kind: str, damping: int) -> float:
    return m[f"{kind}/{damping}"]["swing"][3]


def _moves(m: dict, *cases: tuple[str, int]) -> str:
    """'largest way 0.8, 0.9 m; steady swing 1.0, 1.1 m'."""
    ways, swings = (", ".join(f"{measured(m, *case):.2f}" for case in cases) for measured in (way, swing))
    return f"largest way {ways} m; steady swing {swings} m"


def _farther(damping: int, more: str, less: str):
    """A rule: at this damping n5 moves farther with one kind of string than with the other."""

    def rule(m):
        text = "with and without: " + _moves(m, ("nsh", damping), ("plain", damping))
        return [of(m, more, damping) > of(m, less, damping) for of in (way, swing)], text

    return rule


def _damped(shown: tuple[int, int], more: int, less: int, factor: float = 1.0):
    """A rule: with either kind of string factor times n5's motion at one damping is more than that at another."""

    def rule(m):
        with_it, without = (_moves(m, *((kind, damping) for damping in shown)) for kind in KINDS)
        holds = [factor * of(m, kind, more) > of(m, kind, less) for kind in KINDS for of in (way, swing)]
        return holds, f"{shown[0]} and {shown[1]}, with: {with_it}; without: {without}"

    return rule


def _away(m: dict, damping: int, period: int) -> tuple[list[float], str]:
    """How far a period is off the last one, of the swing; and in words."""
    found = [m[f"{kind}/{damping}"]["away"][period - 1] for kind in KINDS]
    return found, "off the last period by {:.1f} % of the swing with NSH, {:.1f} % without".format(*(100 * x for x in found))


def forces(m: dict, name: str) -> tuple[float, float]:
    return m["nsh/500"][name], m["plain/500"][name]


claim("II", "d = 500: n5 moves farther without NSH.")(_farther(500, "plain", "nsh"))


@claim("II", "d = 500: the steady response with NSH is more than two times smaller.")
def _two_times_smaller(m):
    with_it, without = (swing(m, kind, 500) for kind in KINDS)
    return [2.0 * with_it < without], f"steady swing {with_it:.2f} m with, {without:.2f} m without"


claim("II", "d = 50: n5 moves farther with NSH.")(_farther(50, "nsh", "plain"))
claim("II", "d = 5000: n5 moves farther without NSH.")(_farther(5000, "plain", "nsh"))
claim("II", "n5 moves farther at d = 50 than at d = 500.")(_damped((50, 500), 50, 500))
claim("II", "n5 moves much less at d = 5000 than at d = 500.")(_damped((5000, 500), 500, 5000, MUCH))


@claim("II", "At high damping the response is periodic after the first period.")
def _periodic(m):
    found, text = _away(m, 5000, 2)
    others = ", ".join(f"{100 * x:.0f}" for x in m["nsh/5000"]["away"])
    holds = [x <= TRANSIENT for x in found]
    return holds, f"d = 5000, second period: {text}; with NSH all periods but the last: {others} %"


@claim("II", "At low damping transients last into the fourth period.")
def _transients(m):
    found, text = _away(m, 50, 4)
    return [x > TRANSIENT for x in found], f"d = 50, fourth period: {text}"


@claim(
    "II",
    "d = 500: elastic forces of n1-n4 are much smaller with NSH.",
    "Under 400 N the NSH bottoms out, and its string's own stiffness carries the peaks.",
)
def _smaller_forces(m):
    peak, mean = forces(m, "force_peak"), forces(m, "force_mean")
    text = "with and without: peak {:.0f} and {:.0f} N, mean {:.0f} and {:.0f} N".format(*peak, *mean)
    return [with_it <= MUCH * without for with_it, without in (peak, mean)], text


@claim("II", "d = 500: bars carry less with NSH.")
def _bars_carry_less(m):
    with_it, without = forces(m, "bar_mean")
    return [with_it < without], f"mean over bars and time, with dampers: {with_it:.0f} and {without:.0f} N"


@claim("II", "d = 500: the NSH's snaps show in the string's force.")
def _snaps_show(m):
    count = m["nsh/500"]["snaps"]
    return [count > 0], f"{count} beams of n1-n4 snap in 5 s"


@claim("II", "NSH increase the absorption of energy (section V).")
def _absorption(m):
    found = {d: [m[f"{kind}/{d}"]["dissipated"] for kind in KINDS] for d in (50, 500, 5000)}
    shown = "; ".join(f"{a / 1e3:.1f} and {b / 1e3:.1f} kJ at d = {d}" for d, (a, b) in found.items())
    return [a > b for a, b in found.values()], f"dissipated in 10 s, with and without: {shown}"


# --- III ---------------------------------------------------------------------------------------------------------


def _swings(m: dict, *names: str) -> tuple[dict[str, bool], dict[str, str]]:
    """System -> whether every coordinate swings clearly more with NSH, and by how much each."""
    swings = {n: list(zip(nsh["swing"], bare["swing"])) for n, (nsh, bare) in pairs(m, *names).items()}
    shown = {n: " / ".join(f"{100 * (a / b - 1):+.0f} %" for a, b in axes) for n, axes in swings.items()}
    return {n: all(a > LARGER * b for a, b in axes) for n, axes in swings.items()}, shown


@claim("III", "Two-bar: the coordinates change more with NSH.")
def _change_more(m):
    larger, shown = _swings(m, "two_bar")
    return [larger["two_bar"]], f"swing with NSH against without, by axis: {shown['two_bar']}"


@claim("III", "Three-bar and six-bar: this cannot be said.")
def _cannot_be_said(m):
    larger, shown = _swings(m, "three_bar", "six_bar")
    return [not x for x in larger.values()], each(shown.get, shown)


@claim("III", "The pattern is cyclic, but nonlinear.")
def _cyclic(m):
    away, harmonics = ([one[key] for one in m.values()] for key in ("away", "harmonics"))
    return [c for a, h in zip(away, harmonics) for c in (a <= 0.1, h > NONLINEAR)], (
        f"last period off the one before by up to {100 * max(away):.1f} % of the way; higher harmonics hold "
        f"{100 * min(harmonics):.1f} to {100 * max(harmonics):.1f} % of the power"
    )


@claim("III", "Six-bar: there are oscillations.")
def _oscillations(m):
    most = {n: [max(one["turns"]) for one in both] for n, both in pairs(m).items()}
    text = "turns of a coordinate per period, at most, with NSH: " + each(lambda n: str(most[n][0]))
    return [count > 2 for count in most["six_bar"]], text


@claim("III", "Displacements are largest in the three-bar system.")
def _largest(m):
    ways = {n: [one["way"] for one in both] for n, both in pairs(m).items()}
    holds = [a > b for other in ("two_bar", "six_bar") for a, b in zip(ways["three_bar"], ways[other])]
    return holds, "largest way with NSH: " + each(lambda n: f"{ways[n][0]:.3f} m")


@claim("III", "NSH make the most difference in the two-bar system.")
def _most_difference(m):
    apart = {n: m[n]["apart"] / m[n]["way"] for n in SYSTEMS}
    text = "largest distance of the paths, of the way without: " + each(lambda n: f"{100 * apart[n]:.0f} %")
    return [apart["two_bar"] > apart[other] for other in ("three_bar", "six_bar")], text


# --- IV ----------------------------------------------------------------------------------------------------------


@claim(
    "IV",
    "More energy is absorbed with NSH.",
    "The work of a constant force is force times way, and the softer spring goes farther: that decides the first period, the "
    "only one that starts from rest. While there is no force the NSH does not come back, and what it still holds is not "
    "dissipated.",
)
def _more_energy(m):
    (nsh, bare), periods = (m["nsh"], m["plain"]), [m[kind]["periods"] for kind in KINDS]
    first = " and ".join(f"{x[0]:.2f}" for x in periods)
    later = " and ".join(f"{sum(x[1:]) / len(x[1:]):.2f}" for x in periods)
    each_later = ", ".join(f"{x:.2f}" for x in nsh["periods"][1:])
    return [nsh["absorbed"] > bare["absorbed"], nsh["periods"][0] > bare["periods"][0]], (
        f"{nsh['absorbed']:.1f} J with, {bare['absorbed']:.1f} J without in 4 s; in the first period {first} J, in the later "
        f"ones {later} J on average (with NSH {each_later} J); the mass ends at {1e3 * nsh['end']:.1f} and "
        f"{1e3 * bare['end']:.1f} mm, with {nsh['stored']:.2f} and {bare['stored']:.2f} J stored"
    )


@claim(
    "IV",
    "Figure 10's axis of power ends at 10 (W).",
    "The label is read from the article's text, the curve was not at hand. An overdamped system's power is about F\u00b2/d at "
    "most.",
)
def _power(m):
    power = [m[kind]["power"] for kind in KINDS]
    return [7.0 < max(power) <= 10.0], "largest power {:.1f} W with, {:.1f} W without".format(*power)


NUMBERED = dict(enumerate(CLAIMS, 1))
