"""The data of the work-precision benchmark: file format and queries."""

from __future__ import annotations

from pathlib import Path

from benchmarks.harness.page import read_json, write_json

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
    """One object per ladder: its rungs as columns."""
    ladders = []
    for key, rungs in grouped(result["rows"], lambda row: tuple(row[name] for name in KEY)).items():
        columns = {name: [row.get(name) for row in rungs] for name in COLUMNS}
        ladders.append(dict(zip(KEY, key)) | {name: c for name, c in columns.items() if any(x is not None for x in c)})
    write_json({name: value for name, value in result.items() if name != "rows"} | {"ladders": ladders}, path)


def load(path: Path) -> dict:
    """What `save` wrote."""
    result, rows = read_json(path), []
    for ladder in result.pop("ladders"):
        for i in range(len(ladder["setting"])):
            found = {name: value[i] if isinstance(value, list) else value for name, value in ladder.items()}
            rows.append(dict.fromkeys(COLUMNS) | found)
    return result | {"rows": rows}


#: Kinds of contenders, as values, or tuples of values, of columns.  adaptive: what `auto` chooses from, and what it could; own:
#: all of ours; across, located: SUNDIALS without root finding and with it.
KINDS = {
    "sundials": {"family": ("cvode", "arkode", "plain")},
    "plain": {"family": "plain"},
    "cvode": {"method": ("cvode_bdf", "cvode_adams"), "events": True},
    "scipy": {"family": "scipy"},
    "article": {"family": "article"},
    "mujoco": {"family": "mujoco"},
    "own": {"family": "kernel"},
    "auto": {"family": "kernel", "method": "auto"},
    "adaptive": {"family": "kernel", "method": ("dop853", "rodas5p", "radau9")},
}
KINDS["across"], KINDS["located"] = (KINDS["sundials"] | {"events": events} for events in (False, True))


def of_kind(rows: list[dict], names: list[str], kind: str) -> list[dict]:
    """The runs of some problems by a kind of contenders."""
    wanted = {name: value if isinstance(value, tuple) else (value,) for name, value in KINDS[kind].items()}
    return [row for row in rows if row["problem"] in names and all(row[name] in those for name, those in wanted.items())]


def fastest(rows: list[dict], problem: str, kind: str, error: float = TARGET) -> dict | None:
    """The run of a problem with the least time among those of a kind that reach an error."""
    fitting = (row for row in of_kind(rows, [problem], kind) if row["error"] is not None and row["error"] <= error)
    return min(fitting, key=lambda row: row["ms_least"], default=None)


def ratio(slow: dict | None, fast: dict | None) -> float | None:
    """Least time of one run over that of another; None where one is missing."""
    return slow["ms_least"] / fast["ms_least"] if slow and fast else None


def ratios(rows: list[dict], names: list[str], slow: str, fast: str = "auto", error: float = TARGET) -> list[float]:
    """Times of the fastest runs of one kind over those of another, where both reach the error."""
    found = [ratio(fastest(rows, name, slow, error), fastest(rows, name, fast, error)) for name in names]
    return [value for value in found if value is not None]


def grouped(rows: list[dict], key) -> dict:
    """Rows by what the key says of them."""
    found: dict = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found


def front(rows: list[dict], quantity: str = "error") -> list[dict]:
    """The runs that no other beats in both median time and error, large errors first."""
    found: list[dict] = []
    for row in sorted((r for r in rows if r.get(quantity) and r["ms_per_s"]), key=lambda r: (r["ms_per_s"], r[quantity])):
        if not found or row[quantity] < found[-1][quantity]:
            found.append(row)
    return found
