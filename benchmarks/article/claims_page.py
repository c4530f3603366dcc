"""Measures what this model and its variants give, judges the article's claims by it, and writes docs/claims.md.

Files: docs/claims.json (the measures), docs/claims.md and its figures docs/figures/claims*.png.
"""

from __future__ import annotations

import time

from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from benchmarks.harness import machine
from benchmarks.harness.page import Page, new_figure, plain, rendered, table
from tensegrity_core.article.experiments import LIFTS

from . import claims as rules
from .claims import CLAIMS, NO, NUMBERED, PARTLY, YES, Claim, swing
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


def report(data: dict) -> str:
    """docs/claims.md."""
    judged = [claim.verdict(data) for claim in CLAIMS]
    runs = [m for m in data["II"].values() if "failure" not in m]
    both = {damping: (one["nsh"], one["plain"]) for damping, one in data["sweep"].items()}
    second = scanned("II").items()
    return rendered(
        "article/claims",
        **data,
        data=data,
        rules=rules,
        titles=TITLES,
        lifts=LIFTS,
        dampings=DAMPINGS,
        variants=VARIANTS,
        repeated_seconds=REPEATED_SECONDS,
        claims_table=claims_table,
        counts={word: judged.count(verdict) for word, verdict in (("all", YES), ("part", PARTLY), ("none", NO))},
        total=len(judged),
        ratios=[swing(m, "nsh", 500) / swing(m, "plain", 500) for m in runs],
        less=[d for d, (honeycomb, bare) in both.items() if honeycomb["swing"][3] < bare["swing"][3]],
        weak=[d for d, (honeycomb, bare) in both.items() if honeycomb["force_peak"] <= rules.MUCH * bare["force_peak"]],
        heavy=[n for n, c in second if c.verdict(data) == NO and c.verdict(data, "d_times_10") == YES],
    )


def collect() -> dict:
    """The measures, what they were measured on and how long it took."""
    began, where = time.perf_counter(), machine.describe()
    return plain({"machine": where, **measure(), "seconds": time.perf_counter() - began}, 6)


PAGE = Page(__doc__, "claims", collect, report, {"claims": draw, "claims_damping": draw_sweep})

if __name__ == "__main__":
    PAGE.main()
