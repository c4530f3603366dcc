"""Measures what this model and its variants give, judges the article's claims by it, and writes docs/claims.md.

Files: docs/claims.json (the measures), docs/claims.md and its figures docs/figures/claims*.png.
"""

from __future__ import annotations

import time

from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from benchmarks.harness import machine
from benchmarks.harness.page import Page, new_figure, plain, table, wrapped
from tensegrity_core.article.experiments import LIFTS

from . import claims as rules
from .claims import CLAIMS, NO, NUMBERED, PARTLY, YES, Claim, swing, way
from .measures import REPEATED_SECONDS, measure
from .variants import VARIANTS

DAMPINGS = (50, 500, 5000)
TITLES = {
    "statics": "Systems and honeycomb (section III)",
    "I": "Experiment I: steady heights",
    "II": "Experiment II: square wave",
    "III": "Experiment III: actuated strings",
    "IV": "Experiment IV: one dimension",
}

# --- figure ------------------------------------------------------------------------------------------------------

#: A verdict's sign and what it is written in, for readers who do not tell the colours apart.
SIGNS = {NO: ("\u2717", "white"), PARTLY: ("~", "black"), YES: ("\u2713", "white"), None: ("", "black")}
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
        verdicts = [[claim.verdict(data, variant.key) for claim in claims.values()] for variant in variants]
        ranks = [[RANKS[verdict] for verdict in row] for row in verdicts]
        colours = {"cmap": ListedColormap(list(COLOURS.values())), "vmin": -0.5, "vmax": 3.5}
        axes.pcolormesh(ranks, **colours, edgecolors="white", linewidth=1.5)
        for i, row in enumerate(verdicts):
            for j, verdict in enumerate(row):
                sign, colour = SIGNS[verdict]
                axes.text(j + 0.5, i + 0.5, sign, color=colour, fontsize=7, ha="center", va="center_baseline")
        axes.set_xticks([i + 0.5 for i in range(len(claims))], [str(number) for number in claims])
        axes.set_yticks([i + 0.5 for i in range(len(variants))], [variant.about.replace("`", "") for variant in variants])
        axes.tick_params(length=0, labelsize=7.5)
        axes.set_xlim(0, max(len(scanned(e)) for e in VARIANTS))
        axes.invert_yaxis()
        axes.grid(False)
        axes.set_title(f"{TITLES[experiment]}; claims by number")
        axes.spines[:].set_visible(False)
    handles = [Patch(color=COLOURS[verdict], label=f"{SIGNS[verdict][0]} {verdict}") for verdict in (YES, PARTLY, NO)]
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
    """Variants under which the claim is judged otherwise, or more or fewer of its conditions hold."""
    claim = NUMBERED[number]
    if claim.whole:
        return ""
    base, found = claim.share(data), {}
    for variant in VARIANTS[claim.experiment]:
        share, verdict = claim.share(data, variant.key), claim.verdict(data, variant.key)
        if share not in (base, None):
            label = verdict if verdict != claim.verdict(data) else "more of it" if share > base else "less of it"
            found.setdefault(label, []).append(variant.about)
    return ". ".join(f"**{label}** with: {'; '.join(names)}" for label, names in found.items()) or "nothing"


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
    """n5's swing and way and the string's force under every variant of II; with NSH, without."""
    head, rows = ["with, without NSH"], []
    for name in ("swing", "way"):
        head += [f"{name}, m, d = {damping}" for damping in DAMPINGS]
    head.append("peak of n1-n4, N, d = 500")
    for variant in VARIANTS["II"]:
        m = data["II"][variant.key]
        if "failure" in m:
            rows.append([variant.about, *["\u2013"] * (len(head) - 1)])
            continue
        moved = [f"{measured(m, 'nsh', d):.2f}, {measured(m, 'plain', d):.2f}" for measured in (swing, way) for d in DAMPINGS]
        rows.append([variant.about, *moved, "{:.0f}, {:.0f}".format(*rules.forces(m, "force_peak"))])
    return table(head, rows)


def lifts_table(data: dict) -> str:
    """Where the prestress moves the snaps, the range and the straightness of experiment I."""
    rows = []
    for variant in VARIANTS["I"]:
        system = {"top": "two_bar", "level": "six_bar"}.get(variant.key.split("_")[0])
        for name in rules.SYSTEMS if variant.key == "base" else [system] if system else []:
            m = data["I"][variant.key]
            honeycomb, bare = m[rules.nsh(name)], m[name]
            ranges = f"{1e3 * honeycomb['range']:.1f}, {1e3 * bare['range']:.1f}"
            about = f"{rules.SYSTEMS[name]}: this model" if variant.key == "base" else variant.about
            cells = [about, rules.shown_steps(honeycomb), ranges, f"{100 * bare['bend']:.1f}"]
            rows.append(cells)
    head = ["", "snaps between, N", "range with, without, mm", "without: off a straight line, % of the range"]
    return table(head, rows)


def oscillator_table(data: dict) -> str:
    """Power and absorbed energy of IV under every variant."""
    rows = []
    for variant in VARIANTS["IV"]:
        m = data["IV"][variant.key]
        values = [
            (m[kind]["power"], m[kind]["periods"][0], m[kind]["absorbed"], m[kind]["stored"]) for kind in ("nsh", "plain")
        ]
        rows.append([variant.about, *(f"{one:.2f}, {other:.2f}" for one, other in zip(*values))])
    head = ["with, without NSH", "largest power, W", "absorbed in 1 s, J", "absorbed in 4 s, J", "of it stored at the end, J"]
    return table(head, rows)


def tally(data: dict) -> str:
    counts = {verdict: sum(claim.verdict(data) == verdict for claim in CLAIMS) for verdict in (YES, PARTLY, NO)}
    return f"Of {len(CLAIMS)} claims {counts[YES]} are reproduced, {counts[PARTLY]} partly, and {counts[NO]} not."


def wave_text(data: dict) -> str:
    """What moves n5."""
    rise = data["rise"]
    return f"""Forces of this size throw the three-bar system between two shapes: without load it stands at
{rise["start"]:.3f} m, and {rise["lift"]:.1f} N on each top node are enough to lift it by {rise["gap"]:.2f} m into the other.
n5's displacement is mostly this change of shape, with NSH and without. The choices of the first figure in numbers:"""


def repeats_text(data: dict) -> str:
    """After how many periods of the wave the motion comes back; docs/experiments.md says it, too, from its own data."""
    others = []
    for key, found in data["repeats"].items():
        kind, damping = key.split("/")
        case, periods = f"At d = {damping} {'with' if kind == 'nsh' else 'without'} NSH", found["periods"]
        if periods is None:
            others.append(f"{case} it does not within {len(found['off'])} periods.")
        elif periods > 1:
            before, there = (f"{100 * found['off'][i]:.1f} % of the swing" for i in (0, periods - 1))
            others.append(
                f"{case} it comes back after {periods} periods of the wave: it is {before} off what it was one period "
                f"before, and {there} off what it was {periods} periods before."
            )
    where = "but for what follows" if others else "in every case"
    return " ".join([f"After {REPEATED_SECONDS:.0f} s n5's motion comes back with each period of the wave, {where}.", *others])


def sweep_text(data: dict) -> str:
    """What the scan says of the claims that are farthest off, and at which damping they come nearer."""
    runs = [m for m in data["II"].values() if "failure" not in m]
    ratios = [swing(m, "nsh", 500) / swing(m, "plain", 500) for m in runs]
    less, weak = [], []
    for damping, both in data["sweep"].items():
        if both["nsh"]["swing"][3] < both["plain"]["swing"][3]:
            less.append(damping)
        if both["nsh"]["force_peak"] <= rules.MUCH * both["plain"]["force_peak"]:
            weak.append(damping)
    halved = "none halves it" if min(ratios) >= 0.5 else "some halve it"
    heavy = [str(n) for n, c in scanned("II").items() if c.verdict(data) == NO and c.verdict(data, "d_times_10") == YES]
    return f"""n5's steady swing at d = 500 with NSH is {min(ratios):.2f} to {max(ratios):.2f} times that without, over all
{len(ratios)} choices; {halved}. Damping changes most: of the dampings below, the swing is smaller with NSH at d =
{", ".join(less)} N s/m, and the peak force of n1-n4 at most half as large at d = {", ".join(weak)} N s/m. With every d ten
times as large, these claims come out that are not reproduced: {", ".join(heavy) or "none"}."""


WORDS = f"""'Almost linear': within {100 * rules.LINEAR:.0f} % of the range. 'Just above': by up to
{100 * rules.SLIGHTLY:.0f} %. 'Much less': at most half. 'Larger' of a coordinate's swing: by {100 * (rules.LARGER - 1):.0f} %
in every coordinate. A transient: more than {100 * rules.TRANSIENT:.0f} % of the swing. 'Cyclic': successive periods within 10 %
of the way; 'nonlinear': more than {100 * rules.NONLINEAR:.1f} % of the power in higher harmonics. At rest: below
{rules.AT_REST:g} m/s. Domains: gaps of more than {1e3 * rules.GAP:.0f} mm. n5 moves farther: in its largest distance from the
start within 5 s, and in its steady swing (the norm of the three coordinates' swings over the ninth and tenth period)."""

INTRODUCTION = """What sections III to V of the article say of its four experiments, and what this model gives: the article's
equations with the corrected moment of inertia (J = m/12 in M), the exact NSH law, and transitions located.
[experiments.md](experiments.md) has the figures; the article's own curves were not at hand to be laid over, only its text."""

OPEN = f"""The article leaves open: the prestress of the two-bar and the six-bar system, what a damper does while its string
shortens, what follows beyond the NSH's end at 9 cm, whether an NSH string keeps its damper, the wave's sign and phase, gravity
of the 3D systems, and all numbers of experiment IV. The last column says which other choice changes a verdict, or how much of a
claim holds. The NSH's law is the article's, single-valued and without the string's own stiffness, but for two choices: with
that stiffness in series, without and with memory ([memory.md](memory.md)). Lifts are the article's, {LIFTS[0]} to {LIFTS[-1]} N
in steps of {LIFTS[1] - LIFTS[0]} N."""


def report(data: dict) -> str:
    """docs/claims.md."""
    where = data["machine"]
    blocks = [
        "# The article's claims",
        f"{INTRODUCTION} {tally(data)}",
        "Each claim is a rule over measured numbers, *partly* where only some of its conditions hold. The article's words are "
        f"taken to mean: {WORDS}",
        OPEN,
        "![Verdicts under every choice: \u2713 yes, ~ partly, \u2717 no](figures/claims.png)",
    ]
    for experiment, title in TITLES.items():
        blocks += [f"## {title}", claims_table(experiment, data)]
        if experiment == "I":
            blocks += ["How the prestress, which is free, moves the curves:", lifts_table(data)]
        if experiment == "IV":
            blocks.append(oscillator_table(data))
        if experiment == "II":
            blocks += [repeats_text(data), wave_text(data), wave_table(data), sweep_text(data)]
            blocks.append("![Swing and string force against the damping](figures/claims_damping.png)")
    blocks.append(
        f"Measured at commit {where['commit']}, {where['date']}, {where['processor']}, in {data['seconds']:.0f} s; the numbers "
        "stand in [claims.json](claims.json). Written by `python -m benchmarks.article.claims_page`; `--redraw` writes page "
        "and figures again from that file."
    )
    return "\n\n".join(wrapped(block) for block in blocks) + "\n"


def collect() -> dict:
    """The measures, what they were measured on and how long it took."""
    began, where = time.perf_counter(), machine.describe()
    return plain({"machine": where, **measure(), "seconds": time.perf_counter() - began}, 6)


PAGE = Page(__doc__, "claims", collect, report, {"claims": draw, "claims_damping": draw_sweep})

if __name__ == "__main__":
    PAGE.main()
