"""Measures the NSH with memory (law "hysteretic") and writes docs/memory.md, its figures and data.

Files: docs/memory.json (the numbers, and what they were measured on), docs/memory.md, docs/data/memory_NAME.csv (series) and
docs/figures/memory_NAME.png.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import Page, plain, read_columns, read_json, table, wrapped, write_json
from tensegrity_core.article.experiments import DAMPINGS, LIFTS
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.model.elements import Series
from tensegrity_core.output.export import write_columns

from .claims import NUMBERED, SYSTEMS
from .memory_figures import FIGURES
from .memory_loops import (
    CELL_REACH,
    CELL_STIFFNESS,
    CLOSED,
    MACHINE_DAMPING,
    PARTIAL,
    REACH,
    RIGID,
    SPEED,
    STIFFNESS,
    SWEEP_STEP,
    beams,
    cells,
    loop,
    scan,
    swept,
    tested,
)
from .memory_runs import (
    APART,
    LAWS,
    LEDGER_DURATION,
    LEDGER_LIFT,
    RAMP_HOLD,
    RAMP_STEP,
    RAMP_TOP,
    first_experiment,
    judged,
    ledger,
    second_experiment,
)

#: Digits of the numbers in the file: enough for the energy accounts.
DIGITS = 12
NAMES = {"base": "the article's NSH", "series": "single-valued, k in series", "memory": "with memory"}

SCENE = """```toml
# memory.toml
extends = ["two_bar_nsh"]
name = "two_bar_memory"
description = "The two-bar system; its NSH has memory"

[nsh.article]
law = "hysteretic"
```

```sh
tensegrity simulate memory.toml --force n3.z=60 --force n4.z=60 --duration 5 --output memory.csv
```"""

ELEMENT = """```toml
# in_series.toml
extends = ["two_bar"]
name = "two_bar_in_series"
description = "The two-bar system; beams and a spring in series, without memory"

[elements]
cord = { kind = "spring", stiffness = 15000.0 }
beam1 = { kind = "beam", Q = 6.0, zeta = 3.0, h = 0.010 }
beam2 = { kind = "beam", Q = 8.0, zeta = 4.0, h = 0.010 }
beam3 = { kind = "beam", Q = 10.0, zeta = 5.0, h = 0.015 }
beam4 = { kind = "beam", Q = 12.0, zeta = 6.0, h = 0.010 }
honeycomb = { kind = "series", parts = ["cord", "beam1", "beam2", "beam3", "beam4"] }

[strings]
s1.element = "honeycomb"
s2.element = "honeycomb"
```

```sh
tensegrity simulate in_series.toml --force n3.z=60 --force n4.z=60 --duration 5 --output in_series.csv
```"""

LAW = """By the article's Algorithm 1 an NSH has one force for each elongation: a beam that snaps does so along its own
curve, nothing is lost, and the way back is the way there. The law `hysteretic` gives it a memory. The displacements u of
the beams are variables of their own that follow, continuously, a local minimum of Σ U_j(u_j) + ½ k (x − Σ u_j)², where x is
the elongation and k the string's own stiffness, in series with the beams. A beam may stand in its falling region II as long
as that minimum is stable. Where it ceases to be one, the beams snap: they go where the overdamped flow c u̇_j = T −
f_j(u_j) takes them, with stops at 0 and 2h, and what the energy falls by is dissipated. Elongation and rate are continuous,
so a snap gives no impulse, only a jump of the tension. Beams need not be metastable (`beams = "any"`): bistable ones stay
snapped when the string goes slack. Any elements in series can have this law, not only beams."""

TIES = """Equal beams come to their maxima together, and numbers that people type make others do so, too. Forces that differ
by no more than 32 units of round-off (32 · 2⁻⁵², 7e-15) of the largest force on the beam's stretch between its extrema are one:
whoever comes to such an end comes there with the others, each to its own. Then the first beam, in the order of the scene, whose
fall (or return) goes on stably moves on, and the others go back; where there is none, the string snaps, and the first of them
starts. Beyond a tie the beam whose extremum is nearer goes, be it by 1e-14 of the force. So the law jumps with its parameters:
where round-off decides whether two beams tie, within 8 units of the 32, either of two stable branches may follow, and a
change in a parameter's last digits may choose the other. Energies add up on both."""

# --- single strings ----------------------------------------------------------------------------------------------


def shown(values, form: str = ".4g") -> str:
    return ", ".join(format(v, form) for v in values)


def of_way(loop: dict, sign: int, key: str, factor: float = 1.0) -> list[float]:
    return [factor * s[key] for s in loop["snaps"] if s["way"] == sign]


def cells_table(data: dict) -> str:
    """Closed form, exact law and kernel of test 1."""
    loop, run = data["cells"], data["cells"]["machine"]
    there = len(of_way(loop, 1, "x"))
    kernel = [s["x"] for s in run["snaps"]]
    before, after = CLOSED["force"]
    rows = [
        ["snaps there, m", shown(CLOSED["there"]), shown(of_way(loop, 1, "x"), ".6f"), shown(kernel[:there], ".6f")],
        ["snaps back, m", shown(CLOSED["back"]), shown(of_way(loop, -1, "x"), ".6f"), shown(kernel[there:], ".6f")],
        [
            "force there, N",
            f"{before:g} to {after:.5f}",
            f"{shown(spread(loop, 1, 'before'))} to {shown(spread(loop, 1, 'after'), '.5f')}",
            "",
        ],
        [
            "loss of a snap, mJ",
            f"{1e3 * CLOSED['loss']:.5f}",
            shown(spread(loop, 0, "loss", 1e3), ".5f"),
            shown(unique([1e3 * s["loss"] for s in run["snaps"]], ".5f"), ".5f"),
        ],
        ["loss of a cycle, mJ", f"{1e3 * CLOSED['cycle']:.5f}", f"{1e3 * loop['loss']:.5f}", f"{1e3 * run['loss']:.5f}"],
        ["area of the loop, mJ", "", f"{1e3 * loop['area']:.5f}", f"{1e3 * (run['work'] - run['dampers']):.5f}"],
    ]
    return table(["three cells", "closed form", "exact law", "kernel"], rows)


def spread(loop: dict, sign: int, key: str, factor: float = 1.0) -> list[float]:
    values = [factor * s[key] for s in loop["snaps"] if sign in (0, s["way"])]
    return unique(values, ".5f")


def unique(values: list[float], form: str) -> list[float]:
    """Those that differ in this form."""
    return list({format(v, form): v for v in values}.values())


def honeycomb_table(data: dict) -> str:
    loop, run = data["honeycomb"], data["honeycomb"]["machine"]
    rows = []
    for snap, found in zip(loop["snaps"], run["snaps"]):
        way, on = "there" if snap["way"] > 0 else "back", " → ".join(regions(at) for at in snap["at"])
        rows.append(
            f"{way} | {on} | {1e2 * snap['x']:.4f} | {1e2 * found['x']:.4f} | {snap['before']:.3f} | {snap['after']:.3f} | "
            f"{1e3 * snap['loss']:.3f} | {1e3 * found['loss']:.3f}"
        )
    head = " | beams 1 to 4 on | elongation, cm | kernel, cm | force before, N | after, N | loss, mJ | kernel, mJ"
    return table(head, rows)


def regions(at: list[int]) -> str:
    """'III II I I': where the beams are."""
    return " ".join(("I", "II", "III", "stop")[n] for n in at)


def honeycomb_text(data: dict) -> str:
    loop, run = data["honeycomb"], data["honeycomb"]["machine"]
    ways = [len(of_way(loop, sign, "x")) for sign in (1, -1)]
    f_min = [beam_extrema(b.Q, b.zeta, b.h).f_min for b in beams()]
    return f"""There are {ways[0]} snaps on the way there and {ways[1]} on the way back. On the way there beam 1 passes its
region II without one, and the others snap from the middle of theirs. Towards a snap the force falls ever more steeply, as a
square root: a sweep in steps of {1e6 * SWEEP_STEP:g} µm last sees {shown(loop["swept"], ".2f")} N before the three. On the
way back the beam with the largest f_min (of {shown(f_min, ".1f")} N) is the first to return. What a beam gives free when it
returns may throw another one over again, which has to return once more. A cycle loses {loop["loss"]:.5f} J, and the loop's
area is {loop["area"]:.5f} J. The kernel's run dissipates {run["dissipated"]:.5f} J, of which the snaps are {run["loss"]:.5f}
J and the damper of the testing machine {run["dampers"]:.5f} J; its force is off the exact law by {run["off"]:.0e} N at most."""


def partial_table(data: dict) -> str:
    rows = []
    for one in data["partial"]:
        snaps = ", ".join(f"{1e2 * s['x']:.2f}" + ("" if s["way"] > 0 else " (back)") for s in one["snaps"])
        turns = " → ".join(f"{1e2 * turn:.1f}" for turn in (0.0, *one["turns"]))
        rows.append([turns, snaps, f"{1e3 * one['loss']:.4f}", f"{1e3 * one['area']:.4f}"])
    return table(["way, cm", "snaps at, cm", "lost in snaps, mJ", "area, mJ"], rows)


def stiffness_text(data: dict, series: dict) -> str:
    found, scan = data["stiffness"], series["stiffness"]
    kernel = found["kernel"]
    refused = f", which refuses {len(kernel['refused'])} of them" if kernel["refused"] else ""
    middle = int(np.argmin(np.abs(np.log(scan["stiffness"] / STIFFNESS))))
    risen = scan["stiffness"][1:][np.diff(scan["loss"]) > 0.0]
    but = f" (but for {shown(risen, '.0f')} N/m, where another snap joins the way back)" if len(risen) else ""
    return f"""The stiffer the string, the less is lost{but}. A beam alone has no snap, and its loop is closed, from k = Q (ζ
− 2)/h on, its steepest fall: {shown(found["beams"], ".0f")} N/m for the four beams. In series the loop never closes, whatever
k is: to a beam that falls the other beams are springs in series, as soft as they are. Beam 1 goes smoothly on the way there
from k = {found["first"]:.1f} N/m on, where 1/k + Σ 1/f'_j of the others on I is less than 1/|f'_1| all along its fall. From
{scan["loss"][0]:.3f} J per cycle at {scan["stiffness"][0]:.0f} N/m the loss falls to {scan["loss"][middle]:.3f} J at
{scan["stiffness"][middle]:.0f} N/m and {scan["loss"][-1]:.4f} J at {scan["stiffness"][-1]:.0e} N/m, and tends to
{found["rigid"]:.4f} J (computed at {RIGID:.0e} N/m). Over the {len(scan["stiffness"])} stiffnesses of the figure the loss
that the kernel's curves give is off by {kernel["off"]:.0e} of it at most{refused}."""


def ledger_table(data: dict) -> str:
    rows = []
    for case, one in data["ledger"].items():
        name, what = case.split("/")
        about = f"{SYSTEMS[name]}, " + (f"lift of {LEDGER_LIFT:g} N" if what == "lift" else f"square wave, d = {what} N s/m")
        rows.append(
            f"{about} | {one['throughput']:.4g} | {one['dissipated']:.7g} | {one['dampers']:.7g} | {one['snaps']:.7g} | "
            f"{one['count']} | {one['gap']:.0e} | {one['closure']:.0e}"
        )
    head = ["", "throughput, J", "dissipated, J", "in dampers, J", "in snaps, J", "snaps", "gap", "ledger"]
    return table(head, rows)


# --- experiments -------------------------------------------------------------------------------------------------


def ramp_table(data: dict) -> str:
    rows = []
    for name, title in SYSTEMS.items():
        for law in LAWS:
            one = data["I"][name][law]["ramp"]
            rows.append(
                [
                    f"{title}, {NAMES[law]}",
                    shown(one["up"], "g"),
                    shown(one["back"], "g"),
                    f"{1e3 * one['apart']:.1f} at {one['apart_lift']:g} N",
                    f"{one['snaps']:.3f}",
                    f"{one['dampers']:.3f}",
                ]
            )
    head = ["", "beams pass f_max at, N", "and return at, N", "heights apart, mm", "lost in snaps, J", "in dampers, J"]
    return table(head, rows)


def first_text(data: dict) -> str:
    apart = ", ".join(f"{title} {1e3 * data['I'][name]['apart']:.2f} mm" for name, title in SYSTEMS.items())
    same = all(data["I"][n]["series"]["snaps"] == data["I"][n]["memory"]["snaps"] for n in SYSTEMS)
    differ = sum(len(data["I"][n]["differ"]) for n in SYSTEMS)
    midway = sum(len(set(data["I"][n]["differ"]) & set(data["I"][n]["midway"])) for n in SYSTEMS)
    others = sum(len(data["I"][n]["midway"]) for n in SYSTEMS) - midway
    where = "There, and at no other lift," if (midway, others) == (differ, 0) else f"At {midway} of these and {others} others"
    lowest = min(beam_extrema(b.Q, b.zeta, b.h).f_min for b in beams())
    three, loop = data["I"]["three_bar"]["memory"]["ramp"], data["honeycomb"]["loss"]
    return f"""*Sudden lifts*, {LIFTS[0]} to {LIFTS[-1]} N in runs of 50 s as in experiment I: under both laws the heights lie
within {apart} of each other, and the beams pass their maxima between {"the same" if same else "other"} lifts. At {differ} of
{len(SYSTEMS) * len(LIFTS)} lifts they differ by more than {1e3 * APART:g} mm. {where} a string without memory rests on the
curve of a beam that has not yet come to bear f_max again, where Algorithm 1 holds the other beams; with memory they give way.
Elsewhere all beams stand on the same rising branches.

*Slow lifts*, to {RAMP_TOP:g} N and back in steps of {RAMP_STEP:g} N that are held for {RAMP_HOLD:g} s: the systems have
hysteresis under both laws, since they jump from one equilibrium to another. With memory the first beams return at larger
lifts. Without it the way back is the way there: the beam that snapped last, with the lowest f_min of {lowest:.1f} N, has to
return first, and in the two-bar and the three-bar system the others then follow at once; with memory each returns for itself.
A part of the energy of the jumps is lost inside the strings. In a cycle each string loses what its loop has: in the three-bar
system {three["snaps"]:.5f} J, which is {three["snaps"] / loop:.5f} times the {loop:.5f} J above."""


def wave_table(data: dict) -> str:
    rows = []
    for d in sorted(DAMPINGS):
        for law in LAWS:
            one = data["II"][law][f"{d:g}"]
            snaps, dampers = one["in_snaps"], one["in_dampers"]
            rows.append(
                f"d = {d:g} N s/m, {NAMES[law]} | {one['way']:.3f} | {one['force_peak']:.1f} | {one['force_mean']:.1f} | "
                f"{one['snaps']} | {snaps[0]:.3f}, {np.mean(snaps[1:]):.3f} | {dampers[0]:.1f}, {np.mean(dampers[1:]):.1f}"
            )
    head = ["", "way of n5, m", "peak of n1-n4, N", "mean, N", "snaps in 5 s", "J per second in snaps", "in dampers"]
    return table(head, rows)


def wave_text(data: dict) -> str:
    shares, apart = [], []
    for d in sorted(DAMPINGS):
        one = data["II"]["memory"][f"{d:g}"]
        shares.append(f"{100 * sum(one['in_snaps']) / one['dissipated']:.3f} %")
        apart.append(f"{1e3 * one['apart']:.1f}")
    dampings = shown(sorted(DAMPINGS), "g")
    return f"""The three-bar system under ±400 N at n4, 5 s. Per second: first that of the first second, then the mean of the
others. At d = {dampings} N s/m snaps are {", ".join(shares)} of what is dissipated: against the square wave's energy the
NSH's loops are small. n5's paths under the two laws are apart by {", ".join(apart)} mm at most."""


def claims_table(data: dict) -> str:
    """Claims whose verdict is not the same under all three laws."""
    rows = []
    for number, laws in data["claims"].items():
        if len({one["verdict"] for one in laws.values()}) > 1:
            cells = [f"**{laws[key]['verdict']}**: {laws[key]['found']}" for key in NAMES]
            rows.append([number, NUMBERED[int(number)].says, *cells])
    return table(["", "the article", *NAMES.values()], rows)


def claims_text(data: dict) -> str:
    changed = [int(n) for n, laws in data["claims"].items() if laws["series"]["verdict"] != laws["memory"]["verdict"]]
    softer = [int(n) for n, laws in data["claims"].items() if laws["base"]["verdict"] != laws["series"]["verdict"]]
    rank = {"no": 0, "partly": 1, "yes": 2}
    gained = [
        str(n)
        for n in changed
        if rank[data["claims"][str(n)]["memory"]["verdict"]] > rank[data["claims"][str(n)]["series"]["verdict"]]
    ]
    total, listed = len(data["claims"]), ", ".join(map(str, changed)) or "none"
    better = f"Towards yes it turns {', '.join(gained)}." if gained else "It turns none towards yes."
    return f"""Of the {total} claims on experiments I to III that [claims.md](claims.md) judges, memory changes the verdict of
these, the own stiffness being in series either way: {listed}. {better} The stiffness in series by itself changes:
{", ".join(map(str, softer)) or "none"}."""


# --- measuring ---------------------------------------------------------------------------------------------------


def measure() -> tuple[dict, dict]:
    """Everything: numbers, and series by the name of their file."""
    numbers, series = {}, {}

    def say(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    say("loops")
    honeycomb = Series(beams(), "hysteretic")
    numbers["cells"] = loop(cells(), CELL_STIFFNESS, (CELL_REACH, 0.0))
    numbers["cells"]["machine"], series["cells"] = tested(cells(), CELL_STIFFNESS, CELL_REACH)
    numbers["honeycomb"] = loop(honeycomb, STIFFNESS, (REACH, 0.0))
    numbers["honeycomb"]["machine"], series["honeycomb"] = tested(honeycomb, STIFFNESS, REACH)
    numbers["honeycomb"]["swept"] = swept(honeycomb, numbers["honeycomb"]["snaps"])
    numbers["partial"] = [{"turns": list(turns), **loop(honeycomb, STIFFNESS, turns)} for turns in PARTIAL]
    say("own stiffness")
    numbers["stiffness"], series["stiffness"] = scan()
    say("energy")
    numbers["ledger"] = ledger()
    say("experiment I")
    numbers["I"], series["I"], series["ramp"] = first_experiment()
    say("experiment II")
    numbers["II"], series["II"] = second_experiment()
    say("claims")
    numbers["claims"] = judged()
    return numbers, series


# --- page --------------------------------------------------------------------------------------------------------


def report(data: dict) -> str:
    """docs/memory.md."""
    where, run = data["machine"], data["cells"]["machine"]
    scan = f"k = {STIFFNESS:g} N/m, pulled to {1e2 * REACH:g} cm and back"
    blocks = [
        "# Memory: the hysteretic NSH",
        LAW,
        TIES,
        "A scene asks for it by one key of the NSH:",
        SCENE,
        "`energy.dissipated` then holds what snaps lose and what dampers take. `tensegrity_core.kernel.simulate` returns each "
        "snap among the transitions, with its loss. A `series` element can have the same key. To compare the laws, the "
        "string's own stiffness must be in series in both, so the single-valued law is asked for as an element:",
        ELEMENT,
        "## Three trilinear cells",
        f"Each cell rises by 100 N/m to 1 N, falls to 0.4 N, and rises again; the string has {CELL_STIFFNESS:g} N/m. Its loop "
        f"has a closed form. The kernel pulls a string between a wall and a moved node at {1e3 * SPEED:g} mm/s, with a damper "
        f"of {MACHINE_DAMPING:g} N s/m; forces agree with the exact law to {run['off']:.0e} N.",
        cells_table(data),
        "![Loop of the cells](figures/memory_cells.png)",
        "## The article's NSH",
        f"Four beams, {scan}.",
        honeycomb_table(data),
        honeycomb_text(data),
        "![Loops of the honeycomb](figures/memory_honeycomb.png)",
        "A way that turns in the middle takes another way back, and what has not snapped has not to return:",
        partial_table(data),
        "## The string's own stiffness",
        stiffness_text(data, data["columns"]),
        "![Loss per cycle](figures/memory_stiffness.png)",
        "## Where the energy goes",
        f"Runs of {LEDGER_DURATION:g} s of the kernel under the law with memory. *In dampers* is the integral of the dampers' "
        "power over Gauss points between the transitions, *in snaps* the sum of the recorded snaps' losses. *Gap* is what is "
        "left of `energy.dissipated`, *ledger* the largest gap of the whole energy balance, both relative to the throughput "
        "∫Σ|power|.",
        ledger_table(data),
        "## Experiment I: heights",
        *first_text(data).split("\n\n"),
        ramp_table(data),
        "![Heights under slow and sudden lifts](figures/memory_I.png)",
        "## Experiment II: square wave",
        wave_text(data),
        wave_table(data),
        "![Displacement and force under the wave](figures/memory_II.png)",
        "## The article's claims",
        claims_text(data),
        claims_table(data),
        f"Measured at commit {where['commit']}, {where['date']}, {where['processor']}, in {data['seconds']:.0f} s; the numbers "
        "stand in [memory.json](memory.json), the series in CSV files: "
        + ", ".join(f"[{name}](data/memory_{name}.csv)" for name in data["series"])
        + ". Written by `python -m benchmarks.article.memory`; `--redraw` writes page and figures again from those files.",
    ]
    return "\n\n".join(filled(block) for block in blocks) + "\n"


def filled(block: str) -> str:
    return block if block.startswith("```") else wrapped(block)


def collect() -> dict:
    """The numbers of the page and the columns of each series."""
    began, where = time.perf_counter(), machine.describe()
    numbers, series = measure()
    data = {"machine": where, "series": list(series), **numbers, "seconds": time.perf_counter() - began}
    return plain(data, DIGITS) | {"columns": series}


def keep(data: dict, path: Path) -> None:
    """The columns in CSV files, the rest in a JSON file."""
    for name, columns in data["columns"].items():
        rounded = {key: np.array(plain(values, DIGITS)) for key, values in columns.items()}
        write_columns(rounded, path.parent / "data" / f"memory_{name}.csv")
    write_json({key: value for key, value in data.items() if key != "columns"}, path)


def read(path: Path) -> dict:
    """What `keep` wrote."""
    data = read_json(path)
    return data | {"columns": {name: read_columns(path.parent / "data" / f"memory_{name}.csv") for name in data["series"]}}


DRAWN = {f"memory_{name}": lambda data, draw=draw: draw(data, data["columns"]) for name, draw in FIGURES.items()}
PAGE = Page(__doc__, "memory", collect, report, DRAWN, keep=keep, read=read)

if __name__ == "__main__":
    PAGE.main()
