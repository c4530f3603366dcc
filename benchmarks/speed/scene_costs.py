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
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import problems
from benchmarks.harness.page import Page, rendered
from benchmarks.harness.timing import recorded, summary
from benchmarks.peers import toolchain
from tensegrity_core.fields import METHODS
from tensegrity_core.files import scratch, write_bytes
from tensegrity_core.kernel import to_bytes
from tensegrity_core.model import Model
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
    models = {name: problems.built_in(name) for name in SCENES}
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


def _summary(values: list[float]) -> dict:
    return summary(values, "batches")


def row(case: Subject, facts: dict, times: dict) -> dict:
    """What docs/scene_costs.json says of a scene; times in ns."""
    result = {"scene": case.name} | {key: int(facts[key]) for key in ("bars", "states", "strings", "blocks", "memory")}
    result |= {part: _summary(times[part]) for part in PARTS}
    if "c" in case.what:
        result |= {f"cold_{part}": _summary(times[f"cold_{part}"]) for part in PARTS}
    if "r" in case.what:
        result |= {"duration": case.duration, "smooth_part": facts["smooth_part"], "full_part": facts["full_part"]}
        result["methods"] = {method: stepping(facts, times, METHODS.index(method)) for method in STEPPED}
    return result


def stepping(facts: dict, times: dict, number: int) -> dict:
    """Steps and transitions of one method, after the definitions above; None: no push made strings change their pieces."""
    kinds = [kind for kind in ("smooth", "full") if f"{kind}_{number}" in times]
    names = ("steps", "rejected", "rhs", "transitions", "restarts")
    counts = {kind: {name: int(facts[f"{kind}_{number}_{name}"]) for name in names} for kind in kinds}
    runs = {kind: _summary(times[f"{kind}_{number}"]) for kind in kinds}
    result = {"step": {key: runs["smooth"][key] / counts["smooth"]["steps"] for key in ("min", "median")}}
    result |= {"runs": runs, "counts": counts, "transition": None, "attempts_lost": None}
    if "full" in kinds:
        result |= {"transition": _summary(times[f"transition_{number}"]), "attempts_lost": facts[f"lost_{number}"]}
    return result


# --- showing -----------------------------------------------------------------------------------------------------


def whole_transition(found: dict) -> float:
    """ns: a transition with the attempts lost by it, each at the mean of the run without transitions (minima)."""
    counts = found["counts"]["smooth"]
    attempt = found["runs"]["smooth"]["min"] / (counts["steps"] + counts["rejected"])
    return found["transition"]["min"] + found["attempts_lost"] * attempt


def large(rows: list[dict]) -> list[dict]:
    """The towers that were measured with empty caches, the smallest first."""
    return sorted((r for r in rows if "cold_rhs" in r), key=lambda r: r["bars"])


def warm(row: dict, part: str) -> float:
    """Time of one call after the other, of that with empty caches, %."""
    return 100.0 * row[part]["min"] / row["cold_" + part]["min"]


def report(result: dict) -> str:
    """docs/scene-costs.md."""
    known = {r["scene"]: r for r in result["rows"]}
    pairs = [("space instead of the plane", SPACE, "two_bar"), ("free bars instead of pinned ones", FREED, "three_bar")]
    pairs += [("NSH", f"{name}_nsh", name) for name in ("two_bar", "three_bar", "six_bar")]
    return rendered(
        "speed/scene_costs",
        **result,
        known=known,
        parts=PARTS,
        stepped=STEPPED,
        others=(SPACE, FREED),
        pairs=[(what, known[more], known[less]) for what, more, less in pairs],
        large=large(result["rows"]),
        whole=whole_transition,
        warm=warm,
    )


@recorded
def collect(rounds: int) -> dict:
    """docs/scene_costs.json."""
    conditions = {"up": problems.PUSH_UP, "aside": problems.PUSH_ASIDE, "tolerance": TOLERANCE, "rounds": rounds}
    return {"conditions": conditions, "rows": measure(subjects(), rounds)}


PAGE = Page(__doc__, "scene_costs", collect, report, options={"rounds": 25})

if __name__ == "__main__":
    PAGE.main()
