"""How a run went and where it ended: the text of `tensegrity simulate`, and the same as data."""

from __future__ import annotations

from typing import Any

from ..model import Model, Result, Transition
from ..model.strength import by_name


def end_of_run(model: Model, result: Result) -> str:
    """What `tensegrity simulate` prints: the cost of the run, and where it ended."""
    stats, places = result.stats, zip(model.node_names, result.position[-1, :, list(model.axes)].T)
    rows = [f"    {name}: {', '.join(f'{x:z.6f}' for x in place)}" for name, place in places]
    forces = [f"    {name}: {force:z.6g}" for name, force in zip(model.string_names, result.string_force[-1])]
    return "\n".join(
        [
            f"{model.name}: {result.times[-1]:g} s in {stats['steps']} steps, {len(result.transitions)} transitions, "
            f"energy ledger closed to {result.ledger_error():.1e}",
            f"  nodes at the end, {', '.join('xyz'[axis] for axis in model.axes)} in m:",
            *rows,
            "  string forces at the end in N:",
            *forces,
            *_utilisation(model, result),
        ]
    )


def _utilisation(model: Model, result: Result) -> list[str]:
    """The largest that each member with a section or a strength had at a sample, the most used ones first."""
    used = sorted(_most_used(model, result).items(), key=lambda one: -one[1])
    return ["  largest utilisation:"] * bool(used) + [f"    {name}: {100.0 * part:.4g} %" for name, part in used]


def _most_used(model: Model, result: Result) -> dict[str, float]:
    return by_name(model, result.bar_utilisation.max(axis=0), result.string_utilisation.max(axis=0))


def data(model: Model, result: Result) -> dict[str, Any]:
    """The same, as JSON takes it: s, m, N, J."""
    events = [
        {"time": t.time, _owner(t): t.name(model), "before": t.before, "after": t.after, "loss": t.loss, **_kind(t)}
        for t in result.transitions
    ]
    axes = list(model.axes)
    return {
        "scene": model.name,
        "time": float(result.times[-1]),
        "statistics": {name: int(count) for name, count in result.stats.items()},
        "transitions": events,
        "ledger_error": result.ledger_error(),
        "nodes": dict(zip(model.node_names, result.position[-1][:, axes].tolist())),
        "largest_utilisation": _most_used(model, result),
        "string_forces": dict(zip(model.string_names, result.string_force[-1].tolist())),
    }


def _owner(transition: Transition) -> str:
    return "string" if transition.contact < 0 else "node"


def _kind(transition: Transition) -> dict[str, str]:
    return {"kind": transition.kind} if transition.kind else {}
