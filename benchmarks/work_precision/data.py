"""The data of the work-precision benchmark: file format and queries."""

from __future__ import annotations

import json
from pathlib import Path

from tensegrity_core.files import write_text

#: The error at which contenders are compared, m.
TARGET = 1e-8
#: What the rungs of a ladder have in common.  cut: tighter settings were left out because of the time limit.
KEY = ("problem", "family", "method", "events", "kind", "cut")
#: Of each rung.  ms_per_s: median over its runs, ms_least: the least, both per simulated second.
COLUMNS = (
    "setting",
    "error",
    "energy_error",
    "ms_per_s",
    "ms_least",
    "runs",
    "steps",
    "rejected",
    "rhs",
    "jacobians",
    "transitions",
    "failure",
)


def metres(error: float) -> str:
    """'1e-8 m'."""
    return f"{error:.0e} m".replace("e-0", "e-")


def save(result: dict, path: Path) -> None:
    """One line per ladder: its rungs as columns."""
    ladders: dict[tuple, dict] = {}
    for row in result["rows"]:
        key = tuple(row[name] for name in KEY)
        ladder = ladders.setdefault(key, dict(zip(KEY, key)))
        for name in COLUMNS:
            ladder.setdefault(name, []).append(row.get(name))
    lines = [
        json.dumps({k: v for k, v in ladder.items() if not isinstance(v, list) or any(x is not None for x in v)})
        for ladder in ladders.values()
    ]
    head = {name: value for name, value in result.items() if name != "rows"}
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(head, indent=1)[:-2] + ',\n "ladders": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"
    write_text(path, text)


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
    """The run of a problem with the least time among those that reach an error; wanted: values, or tuples of values, of its
    columns."""
    fitting = [row for row in rows if row["problem"] == problem and row["error"] is not None and row["error"] <= error]
    for name, value in wanted.items():
        allowed = value if isinstance(value, tuple) else (value,)
        fitting = [row for row in fitting if row[name] in allowed]
    return min(fitting, key=lambda row: row["ms_least"], default=None)


def ratio(slow: dict | None, fast: dict | None) -> float | None:
    """Least time of one run over that of another; None where one is missing."""
    return slow["ms_least"] / fast["ms_least"] if slow and fast else None


def ratios(rows: list[dict], names: list[str], slow: dict, fast: dict, error: float = TARGET) -> list[float]:
    """Times of the fastest runs of one kind over those of another, where both reach the error."""
    found = [ratio(fastest(rows, name, error, **slow), fastest(rows, name, error, **fast)) for name in names]
    return [value for value in found if value is not None]


#: Kinds of contenders, as conditions for the functions above.
SUNDIALS = {"family": ("cvode", "arkode", "plain")}
PLAIN = {"family": "plain"}
CVODE = {"method": ("cvode_bdf", "cvode_adams"), "events": True}
SCIPY = {"family": "scipy"}
OWN = {"family": "kernel"}
AUTO = {"family": "kernel", "method": "auto"}
#: What `auto` chooses from, and what it could.
ADAPTIVE = {"family": "kernel", "method": ("dop853", "rodas5p", "radau9")}


def front(rows: list[dict], quantity: str = "error") -> list[dict]:
    """The runs that no other beats in both median time and error, large errors first."""
    found: list[dict] = []
    for row in sorted((r for r in rows if r.get(quantity) and r["ms_per_s"]), key=lambda r: (r["ms_per_s"], r[quantity])):
        if not found or row[quantity] < found[-1][quantity]:
            found.append(row)
    return found
