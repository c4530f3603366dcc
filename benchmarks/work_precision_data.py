"""The data of the work-precision benchmark: file format and queries."""

from __future__ import annotations

import json
from pathlib import Path

#: The error at which contenders are compared, m.
TARGET = 1e-8
KEY = ("problem", "family", "method", "events", "kind")
COLUMNS = ("setting", "error", "energy_error", "ms_per_s", "runs", "steps", "rejected", "rhs", "jacobians", "transitions",
           "failure")  # fmt: skip


def save(result: dict, path: Path) -> None:
    """One line per ladder: its rungs as columns."""
    ladders: dict[tuple, dict] = {}
    for row in result["rows"]:
        key = tuple(row[name] for name in KEY)
        ladder = ladders.setdefault(key, dict(zip(KEY, key)))
        for name in COLUMNS:
            ladder.setdefault(name, []).append(row.get(name))
    lines = []
    for ladder in ladders.values():
        lines.append(json.dumps({k: v for k, v in ladder.items() if not isinstance(v, list) or any(x is not None for x in v)}))
    head = {name: value for name, value in result.items() if name != "rows"}
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(head, indent=1)[:-2] + ',\n "ladders": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"
    path.write_text(text, encoding="utf-8")


def load(path: Path) -> dict:
    """What `save` wrote."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; measure first, without --redraw")
    result = json.loads(path.read_text(encoding="utf-8"))
    rows = []
    for ladder in result.pop("ladders"):
        for i in range(len(ladder["setting"])):
            found = {name: value[i] if isinstance(value, list) else value for name, value in ladder.items()}
            rows.append(dict.fromkeys(COLUMNS) | found)
    return result | {"rows": rows}


def fastest(rows: list[dict], problem: str, error: float = TARGET, **wanted) -> dict | None:
    """The fastest run of a problem that reaches an error; wanted: values, or tuples of values, of its columns."""
    fitting = [row for row in rows if row["problem"] == problem and row["error"] is not None and row["error"] <= error]
    for name, value in wanted.items():
        allowed = value if isinstance(value, tuple) else (value,)
        fitting = [row for row in fitting if row[name] in allowed]
    return min(fitting, key=lambda row: row["ms_per_s"], default=None)


def ratios(rows: list[dict], names: list[str], slow: dict, fast: dict, error: float = TARGET) -> list[float]:
    """Times of the fastest runs of one kind over those of another, where both reach the error."""
    pairs = [(fastest(rows, name, error, **slow), fastest(rows, name, error, **fast)) for name in names]
    return [a["ms_per_s"] / b["ms_per_s"] for a, b in pairs if a and b]


#: Kinds of contenders, as conditions for the two functions above.
SUNDIALS = {"family": ("cvode", "arkode", "plain")}
PLAIN = {"family": "plain"}
SCIPY = {"family": "scipy"}
OWN = {"family": "kernel"}
AUTO = {"family": "kernel", "method": "auto"}
#: What `auto` chooses from, and what it could.
ADAPTIVE = {"family": "kernel", "method": ("dop853", "rodas5p", "radau9")}


def front(rows: list[dict], quantity: str = "error") -> list[tuple[float, float]]:
    """(error, time) of the runs that no other beats in both, large errors first."""
    points = sorted((row["ms_per_s"], row[quantity]) for row in rows if row.get(quantity) and row["ms_per_s"])
    found: list[tuple[float, float]] = []
    for time, error in points:
        if not found or error < found[-1][0]:
            found.append((error, time))
    return found
