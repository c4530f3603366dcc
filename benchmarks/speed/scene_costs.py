"""What a scene costs, and what it does not pay for: ``python -m benchmarks.speed.scene_costs`` writes docs/scene_costs.json and
docs/scene-costs.md, in about 3 minutes.

Everything is measured in C (scene_costs*.c, compiled with the kernel's own sources and flags); a C compiler is needed.  Times
are processor times.  All scenes take part in every round, so that they see the same state of the machine; shown are the
minimum and the median over the rounds.  Definitions:

* parts of a step: calls one after the other at a state of the scene's motion, all strings as at its start;
* step: a run in which no string changes its piece, over its accepted steps, so with the rejected ones and with step size
  control, search for transitions and outputs.  The push is reduced by halves until no method meets a transition;
* transition: from the search that finds one on a step's dense output to the derivative from which the next step starts, so
  location, state, switch and new start; strings that switch together count once.  The push is doubled until every method
  meets transitions;
* attempts lost: the step with the transition goes only part of its way, and those after the new start are short or rejected
  until one is as long again: the attempted steps of that time, less as many of the former length as cover it;
* cold: one call after the caches were emptied.
"""

from __future__ import annotations

import subprocess
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.harness import machine, problems
from benchmarks.harness.page import Page, table, wrapped
from benchmarks.peers import toolchain
from tensegrity_core.fields import METHODS
from tensegrity_core.files import scratch, write_bytes
from tensegrity_core.kernel import to_bytes
from tensegrity_core.model import Model
from tensegrity_core.scene import load_scene
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model

STEPPED = ("dop853", "rodas5p", "radau9", "ros2")
PARTS = {
    "rhs": "right-hand side",
    "jacobian": "Jacobian",
    "factorisation": "factorisation",
    "solve": "solve",
    "complex_factorisation": "complex factorisation",
    "complex_solve": "complex solve",
}
SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")
TOWERS = {10: 0.2, 100: 0.05}  # stages: duration of a run, s
LARGE = (100, 500, 1000)  # stages of the towers that are also measured with empty caches
SPACE, FREED = "two_bar in space", "three_bar without supports"
TOLERANCE, DURATION = 1e-8, 1.0
PARTS_ONLY, RUNS, COLD = "p", "pr", "pc"  # letters of scene_costs.c

# --- scenes ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Subject:
    """A scene to measure; what: letters of scene_costs.c; duration: of a run, s."""

    name: str
    model: Model
    what: str
    duration: float = DURATION

    @property
    def force(self) -> np.ndarray:
        """(F * D,) N: the kernel's input `force`, the push of the problems."""
        return problems.kernel_force(self.model, problems.push(self.model))


def subjects() -> list[Subject]:
    """All scenes, and the same in other forms to compare with."""
    models = {name: build_model(load_scene(name)) for name in SCENES}
    found = [Subject(name, model, RUNS) for name, model in models.items()]
    for stages in sorted({*TOWERS, *LARGE}):
        what = (RUNS if stages in TOWERS else PARTS_ONLY) + (COLD[1:] if stages in LARGE else "")
        found.append(Subject(tower_name(stages), build_model(tower(stages)), what, TOWERS.get(stages, DURATION)))
    found.append(Subject(SPACE, replace(models["two_bar"], axes=(0, 1, 2)), PARTS_ONLY, 1e-3))
    supports = np.zeros(len(models["three_bar"].nodes), dtype=bool)
    found.append(Subject(FREED, replace(models["three_bar"], fixed=supports, gravity=0.0), PARTS_ONLY, 1e-3))
    return found


def tower_name(stages: int) -> str:
    return f"tower of {stages}"


# --- measuring ---------------------------------------------------------------------------------------------------


def build(folder: Path) -> Path:
    """Compile scene_costs.c with the kernel's sources, but for the stepping loop, which has its traced twin."""
    sources = [str(Path(__file__).with_suffix(".c")), str(Path(__file__).with_name("scene_costs_traced.c"))]
    return toolchain.compile_program(sources + toolchain.kernel_sources("integrate.c"), folder / "scene_costs")


def measure(cases: list[Subject], rounds: int) -> list[dict]:
    """One row per scene: facts, and {min, median, batches} of each time in ns."""
    with scratch() as folder:
        command = [str(build(folder)), str(rounds), ",".join(str(METHODS.index(method)) for method in STEPPED)]
        for i, case in enumerate(cases):
            model, force = folder / f"{i}.model", folder / f"{i}.force"
            write_bytes(model, to_bytes(case.model, tolerance=TOLERANCE))
            write_bytes(force, case.force.tobytes())
            command += [str(model), str(force), repr(case.duration), case.what]
        run = subprocess.run(command, capture_output=True, text=True)
        if run.returncode:
            raise SystemExit(run.stderr)
    facts, times = parse(run.stdout)
    return [row(case, facts[i], times[i]) for i, case in enumerate(cases)]


def parse(output: str) -> tuple[dict, dict]:
    """Facts and lists of times (ns), by scene and name."""
    facts: dict[int, dict] = defaultdict(dict)
    times: dict[int, dict] = defaultdict(lambda: defaultdict(list))
    for line in output.splitlines():
        number, name, *value = line.split()
        if value[0] == "=":
            facts[int(number)][name] = float(value[1])
        else:
            times[int(number)][name].append(float(value[0]))
    return facts, times


def summary(values: list[float]) -> dict:
    return {"min": min(values), "median": median(values), "batches": len(values)}


def row(case: Subject, facts: dict, times: dict) -> dict:
    """What docs/scene_costs.json says of a scene; times in ns."""
    result = {"scene": case.name} | {key: int(facts[key]) for key in ("bars", "states", "strings", "blocks", "memory")}
    for part in PARTS:
        result[part] = summary(times[part])
        if "c" in case.what:
            result["cold_" + part] = summary(times["cold_" + part])
    if "r" in case.what:
        result |= {"duration": case.duration, "smooth_part": facts["smooth_part"], "full_part": facts["full_part"]}
        result["methods"] = {method: stepping(facts, times, METHODS.index(method)) for method in STEPPED}
    return result


def stepping(facts: dict, times: dict, number: int) -> dict:
    """Steps and transitions of one method, after the definitions above; None: no push made strings change their pieces."""
    kinds = [kind for kind in ("smooth", "full") if f"{kind}_{number}" in times]
    names = ("steps", "rejected", "rhs", "transitions", "restarts")
    counts = {kind: {name: int(facts[f"{kind}_{number}_{name}"]) for name in names} for kind in kinds}
    runs = {kind: summary(times[f"{kind}_{number}"]) for kind in kinds}
    result = {"step": {key: runs["smooth"][key] / counts["smooth"]["steps"] for key in ("min", "median")}}
    result |= {"runs": runs, "counts": counts, "transition": None, "attempts_lost": None}
    if "full" in kinds:
        result |= {"transition": summary(times[f"transition_{number}"]), "attempts_lost": facts[f"lost_{number}"]}
    return result


# --- showing -----------------------------------------------------------------------------------------------------


def number(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.3g}" if value < 1000.0 else f"{float(f'{value:.3g}'):.0f}"


def cell(values: dict | None, scale: float = 1.0) -> str:
    """Minimum and median."""
    return "–" if values is None else f"{number(scale * values['min'])} ({number(scale * values['median'])})"


def part_rows(rows: list[dict]) -> str:
    head = ["scene", "bars", "states", "strings", *PARTS.values()]
    body = [[r["scene"], *(str(r[key]) for key in ("bars", "states", "strings")), *(cell(r[p]) for p in PARTS)] for r in rows]
    return table(head, body)


def step_cell(found: dict) -> str:
    return f"{cell(found['step'], 1e-3)}; {found['counts']['smooth']['steps']}"


def step_rows(rows: list[dict]) -> str:
    body = [[r["scene"], f"{r['duration']:g}", *(step_cell(r["methods"][m]) for m in STEPPED)] for r in rows]
    return table(["scene", "run of, s", *(f"`{m}`" for m in STEPPED)], body)


def transition_cell(found: dict) -> str:
    if found["transition"] is None:
        return "–"
    return f"{cell(found['transition'], 1e-3)}; {found['attempts_lost']:.1f}; {found['counts']['full']['restarts']}"


def transition_rows(rows: list[dict]) -> str:
    body = [[r["scene"], f"{r['full_part']:g}", *(transition_cell(r["methods"][m]) for m in STEPPED)] for r in rows]
    return table(["scene", "push", *(f"`{m}`" for m in STEPPED)], body)


def ratio_rows(known: dict[str, dict]) -> str:
    """Parts of the scene that has something, over those of the one that has not."""
    pairs = [("space instead of the plane", SPACE, "two_bar"), ("free bars instead of pinned ones", FREED, "three_bar")]
    pairs += [("NSH", f"{name}_nsh", name) for name in ("two_bar", "three_bar", "six_bar")]
    body = []
    for what, more, less in pairs:
        a, b = known[more], known[less]
        ratios = [f"{a[part]['min'] / b[part]['min']:.2f}" for part in PARTS]
        body.append([what, f"{more} / {less}", f"{a['states']} / {b['states']}", *ratios])
    return table(["what", "scenes", "states", *PARTS.values()], body)


def whole_transition(found: dict) -> float:
    """ns: a transition with the attempts lost by it, each at the mean of the run without transitions (minima)."""
    counts = found["counts"]["smooth"]
    attempt = found["runs"]["smooth"]["min"] / (counts["steps"] + counts["rejected"])
    return found["transition"]["min"] + found["attempts_lost"] * attempt


def nsh_rows(known: dict[str, dict]) -> str:
    """With NSH over without, by method: a second without transitions, and a transition with the attempts lost by it."""
    body = []
    for name in ("two_bar", "three_bar", "six_bar"):
        with_nsh, plain = known[f"{name}_nsh"]["methods"], known[name]["methods"]
        cells = []
        for m in STEPPED:
            a, b = with_nsh[m], plain[m]
            second = a["runs"]["smooth"]["min"] / b["runs"]["smooth"]["min"]
            both = a["transition"] and b["transition"]
            cells.append(f"{second:.2f}; " + (f"{whole_transition(a) / whole_transition(b):.2f}" if both else "–"))
        body.append([name, *cells])
    return table(["scene", *(f"`{m}`" for m in STEPPED)], body)


def large(rows: list[dict]) -> list[dict]:
    """The towers that were measured with empty caches, the smallest first."""
    return sorted((r for r in rows if "cold_rhs" in r), key=lambda r: r["bars"])


def cold_rows(rows: list[dict]) -> str:
    """Warm and cold, per block of the matrices."""
    body = []
    for r in large(rows):
        times = [f"{number(r[p]['min'] / r['blocks'])}; {number(r['cold_' + p]['min'] / r['blocks'])}" for p in PARTS]
        body.append([r["scene"], f"{1e-6 * r['memory']:.0f}", *times])
    return table(["scene", "MB", *PARTS.values()], body)


def cache_text(rows: list[dict]) -> str:
    """What the smallest and the largest of these towers say."""
    first, last = large(rows)[0], large(rows)[-1]
    each = []
    for part, label in PARTS.items():
        shares = [100.0 * r[part]["min"] / r["cold_" + part]["min"] for r in (first, last)]
        growth = (last[part]["min"] / last["blocks"]) / (first[part]["min"] / first["blocks"])
        each.append(f"{label} {shares[0]:.0f} and {shares[1]:.0f} % ({growth:.2f})")
    return (
        "ns for each block of the Jacobian: one call after the other; with empty caches. The work per block is the same at any "
        f"size. One call after the other takes, of the time with empty caches, in the {first['scene']} and in the "
        f"{last['scene']}: {', '.join(each)}; in parentheses, by what factor the time per block rises from the one to the "
        "other. A part whose share is near 100 % in the larger one works from memory there; one whose share is as high in the "
        "smaller one is bound by arithmetic."
    )


def report(result: dict) -> str:
    """docs/scene-costs.md."""
    rows, where, conditions = result["rows"], result["machine"], result["conditions"]
    known = {r["scene"]: r for r in rows}
    stepped = [r for r in rows if "methods" in r]
    first, last = known["two_bar"], large(rows)[-1]
    per_string = [number(r["rhs"]["min"] / r["strings"]) for r in (first, last)]
    blocks = [
        "# What a scene costs",
        "Written by `python -m benchmarks.speed.scene_costs`, which also defines each quantity; the figures stand in "
        f"[scene_costs.json](scene_costs.json), and `--redraw` writes this page from them. Measured from C, in processor time, "
        f"on {where['processor']}, {where['system']}, one thread, commit {where['commit']}, {where['date']}, in "
        f"{result['seconds']} s; minimum (median) of {min(r['rhs']['batches'] for r in rows)} batches or more.",
        "## Parts of a step, ns",
        "States are positions and velocities in generalised coordinates: a pinned bar has one vector of each, a free bar "
        f"two. A right-hand side takes {per_string[0]} ns for each string of two_bar and {per_string[1]} ns for each of "
        f"the {last['strings']} of the {last['scene']}; the complex systems are those of `radau9`.",
        part_rows([r for r in rows if r["scene"] not in (SPACE, FREED)]),
        "## An accepted step, µs",
        f"Mean over a run without transitions at tolerance {conditions['tolerance']:g} (`ros2`: steps of 1 ms), with all that "
        "belongs to it: rejected steps, error control, the search for transitions, outputs; then how many steps that run took.",
        step_rows(stepped),
        "## A transition",
        "µs for location, switching and the new start; then the attempts lost by it: those from the step that it cuts short "
        "until the steps are as long again, less as many of the former length as cover that time; then how many transitions "
        f"there were. The push is {conditions['up']:g} N up on the top nodes and {conditions['aside']:g} N aside on one of "
        "them, times the number in the second column.",
        transition_rows(stepped),
        "## What a scene does not pay for",
        "Times of the scene that has something over those of the same one without it (minima): two_bar computed in space "
        "instead of in its plane, three_bar with its supports taken away, scenes with NSH. The kernel leaves out what a "
        "scene has not, and a ratio above 1 is what that saves.",
        ratio_rows(known),
        "With NSH over without, by method: the run without transitions; a transition with the attempts lost by it, each at "
        "the mean time of an attempt in the run without transitions.",
        nsh_rows(known),
        "## Caches",
        cache_text(rows),
        cold_rows(rows),
    ]
    return wrapped("\n\n".join(blocks)) + "\n"


def collect(rounds: int) -> dict:
    """docs/scene_costs.json."""
    began, where = time.perf_counter(), machine.describe()
    conditions = {"up": problems.PUSH_UP, "aside": problems.PUSH_ASIDE, "tolerance": TOLERANCE, "rounds": rounds}
    rows = measure(subjects(), rounds)
    return {"machine": where, "conditions": conditions, "seconds": round(time.perf_counter() - began), "rows": rows}


PAGE = Page(__doc__, "scene_costs", collect, report, options={"rounds": 25})

if __name__ == "__main__":
    PAGE.main()
