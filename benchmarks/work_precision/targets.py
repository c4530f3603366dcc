"""What was asked of the speed, what the data reach, and why where they do not."""

from __future__ import annotations

from typing import NamedTuple

from . import nsh
from .data import ADAPTIVE, AUTO, SCIPY, SUNDIALS, TARGET, fastest, metres, ratio

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
        name: [ratio(fastest(rows, name, error, **AUTO), fastest(rows, name, error, **ADAPTIVE)) for error in ERRORS]
        for name in result["problems"]
    }


def listed(result: dict) -> list[Target]:
    """Those that the data tell."""
    rows, found = result["rows"], []
    for damping, asked in OVER_SUNDIALS.items():
        auto = fastest(rows, name_of(damping), **AUTO)
        reached = ratio(fastest(rows, name_of(damping), **SUNDIALS), auto)
        if reached:
            found.append(Target(f"best SUNDIALS / `auto`, d = {damping}", f"≥ {asked:g}", f"{reached:.3g}", reached >= asked))
    scipy = [ratio(fastest(rows, name_of(d), **SCIPY), fastest(rows, name_of(d), **AUTO)) for d in OVER_SUNDIALS]
    if known := [value for value in scipy if value]:
        what = "best SciPy over the compiled right-hand side / `auto`, least over d"
        found.append(Target(what, f"≥ {OVER_SCIPY:g}", f"{min(known):.3g}", min(known) >= OVER_SCIPY))
    for damping, (asked, aim) in TRIAL_MS.items():
        if auto := fastest(rows, name_of(damping), **AUTO):
            time = auto["ms_least"]
            reached = f"{time:.3g}, aim {'met' if time <= aim else 'missed'}"
            found.append(Target(f"`auto`, ms, d = {damping}", f"≤ {asked:g}, aim {aim:g}", reached, time <= asked))
    return found + own_targets(result) + nsh_targets(result)


def own_targets(result: dict) -> list[Target]:
    values = [value for line in over_own(result).values() for value in line if value is not None]
    if not values:
        return []
    over = sum(value > OVER_OWN for value in values)
    reached = f"{max(values):.3g}; above in {over} of {len(values)}"
    return [Target("`auto` / our best other, largest over problems and errors", f"≤ {OVER_OWN:g}", reached, not over)]


def nsh_targets(result: dict) -> list[Target]:
    """Largest ratio over the dampings."""
    runs, found = result.get("nsh", []), []
    both = [nsh.costs(runs, damping) for damping in dict.fromkeys(run["damping"] for run in runs)]
    for which, what in enumerate(("a transition-free second", "a transition")):
        if known := [costs[which].ratio for costs in both if costs[which]]:
            text = f"{what} with NSH / without, largest over d"
            found.append(Target(text, f"≤ {OVER_PLAIN:g}", f"{max(known):.3g}", max(known) <= OVER_PLAIN))
    return found


def shortfall(result: dict, damping: int, label) -> str | None:
    """Why SUNDIALS is not beaten by as much as was asked, from counts and the time of a right-hand side; None where it is.
    label: names a run's method."""
    name, asked = name_of(damping), OVER_SUNDIALS[damping]
    auto, best = (fastest(result["rows"], name, **kind) for kind in (AUTO, SUNDIALS))
    if not auto or not best or ratio(best, auto) >= asked:
        return None
    ns = result["problems"][name]["rhs_ns"]
    bare = 1e-6 * auto["rhs"] * ns  # ms: right-hand sides alone
    text = (
        f"d = {damping}: to come within {metres(TARGET)} the fastest run of SUNDIALS, {label(best)}, evaluates {best['rhs']} "
        f"right-hand sides and takes {best['ms_least']:.3g} ms; `auto` evaluates {auto['rhs']}. At {ns:.0f} ns each, a kernel "
        f"whose every other cost were zero would take {bare:.2g} ms, and so be {best['ms_least'] / bare:.3g} times as fast. "
    )
    if best["ms_least"] / bare < asked:
        allowed = 1e6 * best["ms_least"] / asked / ns
        return text + (
            f"{asked:g} is out of reach unless no more than {allowed:.0f} right-hand sides are needed; a faster right-hand "
            "side would not do it, because SUNDIALS calls the same one."
        )
    spent = auto["ms_least"] - bare
    return text + (
        f"The other {spent:.2g} ms are those of {auto['jacobians']} Jacobians with their factorisations and solves, of step "
        "size control, dense output and transitions: there the target would have to be gained."
    )


def scipy_shortfall(result: dict, label) -> str | None:
    """The same of SciPy, at the damping where it comes closest."""
    pairs = [(d, *(fastest(result["rows"], name_of(d), **kind) for kind in (SCIPY, AUTO))) for d in OVER_SUNDIALS]
    near = min((pair for pair in pairs if pair[1] and pair[2]), key=lambda pair: ratio(*pair[1:]), default=None)
    if near is None or ratio(*near[1:]) >= OVER_SCIPY:
        return None
    damping, scipy, auto = near
    each = [row["ms_least"] / row["rhs"] for row in (scipy, auto)]
    return (
        f"SciPy comes closest at d = {damping}: {label(scipy)} evaluates {scipy['rhs']} right-hand sides, with "
        f"{1e3 * each[0]:.2g} µs for each and all that is done around it, `auto` {auto['rhs']} with {1e3 * each[1]:.2g} µs. "
        "SciPy's time is that of its calls from Python, whatever the right-hand side costs."
    )


def own_shortfall(result: dict) -> str | None:
    """Where `auto` is furthest behind our other methods; None where it never exceeds the bound."""
    cells = [(v, name, e) for name, line in over_own(result).items() for v, e in zip(line, ERRORS) if v and v > OVER_OWN]
    if not cells:
        return None
    worst = []
    for value, name, error in sorted(cells, reverse=True)[:3]:
        auto, own = (fastest(result["rows"], name, error, **kind) for kind in (AUTO, ADAPTIVE))
        both = f"{auto['ms_least']:.2g} ms, `{own['method']}` {own['ms_least']:.2g} ms"
        worst.append(f"{name} at {metres(error)} ({value:.2f}: {both})")
    return f"`auto` is furthest behind in {'; '.join(worst)}."
