"""What was asked of the speed, what the data reach, and why where they do not."""

from __future__ import annotations

from typing import NamedTuple

from . import nsh
from .data import fastest, ratio

#: By damping, N s/m: how many times faster than SUNDIALS `auto` is to be; ms that an earlier trial of the same physics reached,
#: and the aim.
OVER_SUNDIALS = {50: 20.0, 500: 12.0, 5000: 12.0}
OVER_SCIPY = 100.0
TRIAL_MS = {50: (0.49, 0.25), 500: (1.08, 0.5), 5000: (3.7, 1.8)}
OVER_OWN = 1.3
OVER_PLAIN = 1.5
#: Errors at which `auto` is compared with our others, m.
ERRORS = (1e-4, 1e-6, 1e-8, 1e-10)


class Target(NamedTuple):
    """what is asked, how much, what was reached, and whether that is enough."""

    what: str
    asked: str
    reached: str
    met: bool


def name_of(damping: float) -> str:
    return f"three_bar/{damping:g}"


def over_own(result: dict) -> dict[str, list[float | None]]:
    """By problem: `auto` over the fastest of our other adaptive methods, at ERRORS."""
    rows = result["rows"]
    return {
        name: [ratio(fastest(rows, name, "auto", error), fastest(rows, name, "adaptive", error)) for error in ERRORS]
        for name in result["problems"]
    }


def known(values) -> list[float]:
    return [value for value in values if value is not None]


def over_peers(result: dict, kind: str) -> dict[int, float | None]:
    """By damping: the fastest peer of a kind over `auto`."""
    rows = result["rows"]
    return {d: ratio(fastest(rows, name_of(d), kind), fastest(rows, name_of(d), "auto")) for d in OVER_SUNDIALS}


def listed(result: dict) -> list[Target]:
    """Those that the data tell."""
    found = []
    for damping, value in over_peers(result, "sundials").items():
        if value:
            asked = OVER_SUNDIALS[damping]
            found.append(Target(f"best SUNDIALS / `auto`, d = {damping}", f"≥ {asked:g}", f"{value:.3g}", value >= asked))
    if scipy := known(over_peers(result, "scipy").values()):
        what = "best SciPy over the compiled right-hand side / `auto`, least over d"
        found.append(Target(what, f"≥ {OVER_SCIPY:g}", f"{min(scipy):.3g}", min(scipy) >= OVER_SCIPY))
    for damping, (asked, aim) in TRIAL_MS.items():
        if auto := fastest(result["rows"], name_of(damping), "auto"):
            time = auto["ms_least"]
            reached = f"{time:.3g}, aim {'met' if time <= aim else 'missed'}"
            found.append(Target(f"`auto`, ms, d = {damping}", f"≤ {asked:g}, aim {aim:g}", reached, time <= asked))
    if own := known(value for line in over_own(result).values() for value in line):
        over = sum(value > OVER_OWN for value in own)
        reached = f"{max(own):.3g}; above in {over} of {len(own)}"
        what = "`auto` / our best other, largest over problems and errors"
        found.append(Target(what, f"≤ {OVER_OWN:g}", reached, not over))
    runs = result.get("nsh", [])
    both = [nsh.costs(runs, damping) for damping in dict.fromkeys(run["damping"] for run in runs)]
    for which, what in enumerate(("a transition-free second", "a transition")):
        if largest := max((costs[which].ratio for costs in both if costs[which]), default=None):
            text = f"{what} with NSH / without, largest over d"
            found.append(Target(text, f"≤ {OVER_PLAIN:g}", f"{largest:.3g}", largest <= OVER_PLAIN))
    return found


def shortfall(result: dict, damping: int) -> dict | None:
    """Of where SUNDIALS is not beaten by as much as was asked: both runs, ns of a right-hand side, the ms that `auto` spends in
    them alone, how many times as fast it would be with nothing else, and how many of them it could afford; else None."""
    name, asked = name_of(damping), OVER_SUNDIALS[damping]
    auto, best = (fastest(result["rows"], name, kind) for kind in ("auto", "sundials"))
    if not auto or not best or ratio(best, auto) >= asked:
        return None
    ns, ms = result["problems"][name]["rhs_ns"], best["ms_least"]
    bare = 1e-6 * auto["rhs"] * ns
    found = {"damping": damping, "asked": asked, "auto": auto, "best": best, "ns": ns}
    return found | {"bare": bare, "most": ms / bare, "allowed": 1e6 * ms / asked / ns}


def scipy_shortfall(result: dict) -> dict | None:
    """The runs of SciPy and `auto` at the damping where SciPy comes closest; None where it is beaten by enough."""
    over = {damping: value for damping, value in over_peers(result, "scipy").items() if value}
    near = min(over, key=over.get, default=None)
    if near is None or over[near] >= OVER_SCIPY:
        return None
    best, auto = (fastest(result["rows"], name_of(near), kind) for kind in ("scipy", "auto"))
    return {"damping": near, "best": best, "auto": auto}


def behind(result: dict) -> list[tuple]:
    """Where `auto` is furthest behind our other methods and beyond the bound: ratio, problem, error, both runs."""
    cells = [(v, name, e) for name, line in over_own(result).items() for v, e in zip(line, ERRORS) if v and v > OVER_OWN]
    return [
        (value, name, error, *(fastest(result["rows"], name, kind, error) for kind in ("auto", "adaptive")))
        for value, name, error in sorted(cells, reverse=True)[:3]
    ]
