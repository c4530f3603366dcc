"""Figures of the work-precision benchmark, from its data."""

from __future__ import annotations

import io
import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from PIL import Image  # noqa: E402
from work_precision_data import front  # noqa: E402

OWN = {"auto": "#000000", "dop853": "#d62728", "rodas5p": "#1f4fd8", "radau9": "#8e24aa", "rk4": "#e08a00", "ros2": "#00897b"}
#: For a method of the kernel that is not listed above.
OTHER = "#e377c2"
#: family, method: label, colour, marker.  A muted colour per kind of peer.
PEERS = {
    ("cvode", "cvode_bdf"): ("CVODE BDF", "#7f9db9", "s"),
    ("cvode", "cvode_adams"): ("CVODE Adams", "#7f9db9", "o"),
    ("arkode", "erk_ARKODE_CASH_KARP_6_4_5"): ("ARKODE Cash-Karp 5(4)", "#8fae8b", "o"),
    ("arkode", "erk_ARKODE_DORMAND_PRINCE_7_4_5"): ("ARKODE Dormand-Prince 5(4)", "#8fae8b", "s"),
    ("arkode", "erk_ARKODE_VERNER_8_5_6"): ("ARKODE Verner 6(5)", "#8fae8b", "^"),
    ("arkode", "erk_ARKODE_FEHLBERG_13_7_8"): ("ARKODE Fehlberg 8(7)", "#8fae8b", "D"),
    ("arkode", "dirk_ARKODE_ESDIRK436L2SA_6_3_4"): ("ARKODE ESDIRK 4(3)", "#a99bb8", "o"),
    ("arkode", "dirk_ARKODE_ESDIRK547L2SA2_7_4_5"): ("ARKODE ESDIRK 5(4)", "#a99bb8", "s"),
    ("arkode", "dirk_ARKODE_KVAERNO_7_4_5"): ("ARKODE Kvaerno 5(4)", "#a99bb8", "^"),
    ("scipy", "RK45"): ("SciPy RK45", "#c9a581", "s"),
    ("scipy", "DOP853"): ("SciPy DOP853", "#c9a581", "o"),
    ("scipy", "Radau"): ("SciPy Radau", "#c9a581", "^"),
    ("scipy", "BDF"): ("SciPy BDF", "#c9a581", "D"),
    ("scipy", "LSODA"): ("SciPy LSODA", "#c9a581", "v"),
    ("article", "RK45"): ("article's equations, RK45 (ode45)", "#8c7b5a", "P"),
    ("article", "DOP853"): ("article's equations, DOP853", "#8c7b5a", "X"),
    ("mujoco", "Euler"): ("MuJoCo Euler", "#9a9a9a", "o"),
    ("mujoco", "implicit"): ("MuJoCo implicit", "#9a9a9a", "s"),
    ("mujoco", "implicitfast"): ("MuJoCo implicitfast", "#9a9a9a", "^"),
    ("mujoco", "RK4"): ("MuJoCo RK4", "#6d6d6d", "D"),
}
#: Families whose ladders are drawn together as what is best of them: a line for each pair of label and condition.
FRONTS = {
    "SUNDIALS, best of all set-ups": (("cvode", "arkode", "plain"), True, {"color": "0.35", "lw": 1.5}),
    "SUNDIALS, best of the plain set-ups": (("plain",), True, {"color": "0.35", "lw": 1.1, "ls": "--"}),
    "SUNDIALS, transitions not located": (("cvode", "arkode"), False, {"color": "#5f7f9f", "lw": 1.0, "ls": ":"}),
    "SciPy, transitions not located": (("scipy",), False, {"color": "#b08050", "lw": 1.0, "ls": ":"}),
}
LEFT, RIGHT = 3e-15, 0.3  # limits of the errors shown; small ones to the left


def label(family: str, method: str) -> str:
    """How a contender is called."""
    if family == "kernel":
        return f"tensegrity kernel: {method}"
    if family == "plain":
        names = {"cvode_bdf": "CVODE BDF", "cvode_adams": "CVODE Adams", "erk": "ARKODE explicit", "dirk": "ARKODE implicit"}
        return (names.get(method) or f"{names[method.split('_')[0]]}, order {method.split('_')[1]}") + ", plain"
    return PEERS[family, method][0]


def plural(count: int, word: str) -> str:
    return f"{count or 'no'} {word}" + ("" if count == 1 else "s")


def _style(family: str, method: str) -> dict:
    """Own methods thick and coloured, peers thin and muted."""
    if family == "kernel":
        return {"color": OWN.get(method, OTHER), "lw": 2.8 if method == "auto" else 2.0, "marker": "o", "ms": 3.4, "zorder": 5}
    _, colour, marker = PEERS[family, method]
    return {"color": colour, "lw": 0.8, "marker": marker, "ms": 2.6, "mfc": "white", "mew": 0.6, "zorder": 2}


def _drawn(rows: list[dict]) -> dict[tuple[str, str], list[dict]]:
    """Rows of the ladders that are drawn one by one: those with events, and of families that have none."""
    found: dict[tuple[str, str], list[dict]] = {}
    located = {row["family"] for row in rows if row["events"]}
    for row in rows:
        if row["error"] and row["ms_per_s"] and row["family"] != "plain" and (row["events"] or row["family"] not in located):
            found.setdefault((row["family"], row["method"]), []).append(row)
    return found


def _fronts(rows: list[dict], quantity: str) -> dict[str, list[tuple[float, float]]]:
    """Lines of FRONTS; none where no contender locates transitions, as each line is drawn by itself then."""
    if not any(row["events"] and row["family"] != "kernel" for row in rows):
        return {}
    found = {}
    for name, (families, events, _) in FRONTS.items():
        if points := front([row for row in rows if row["family"] in families and row["events"] == events], quantity):
            found[name] = points
    return found


def _panel(axes, rows: list[dict], floor: float, quantity: str = "error") -> None:
    for key, ladder in _drawn(rows).items():
        if points := [(row[quantity], row["ms_per_s"]) for row in ladder if row.get(quantity)]:
            axes.plot(*zip(*points), **_style(*key))
    for name, points in _fronts(rows, quantity).items():
        axes.plot(*zip(*points), zorder=3, **FRONTS[name][2])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(LEFT, RIGHT)
    axes.set_xticks([10.0**e for e in range(-14, 0, 2)])
    if quantity == "error":
        axes.axvspan(LEFT, max(floor, LEFT), color="0.93", lw=0, zorder=0)
    axes.grid(True, which="major", lw=0.3, color="0.85")


def _legend(figure, rows: list[dict], columns: int) -> None:
    order = ["kernel", *dict.fromkeys(family for family, _ in PEERS)]
    keys = sorted(_drawn(rows), key=lambda key: order.index(key[0]))
    handles = [Line2D([], [], label=label(*key), **_style(*key)) for key in keys]
    handles += [Line2D([], [], label=name, **FRONTS[name][2]) for name in _fronts(rows, "error")]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=7.5, frameon=False)


def _store(figure, folder: Path, name: str) -> None:
    """PNG and SVG, the same bytes for the same data."""
    folder.mkdir(parents=True, exist_ok=True)
    png, svg = io.BytesIO(), io.StringIO()
    figure.savefig(png, dpi=110, format="png")
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)
    Image.open(png).convert("RGB").quantize(64, dither=Image.Dither.NONE).save(folder / f"work_precision_{name}.png", optimize=True)
    shorter = re.sub(r"\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", svg.getvalue())
    (folder / f"work_precision_{name}.svg").write_text(shorter, encoding="utf-8")


def _floor(about: dict) -> float:
    """Where the reference itself ends, m: how far the nearest other method is from it."""
    return min(about["reference_difference"].values())


def _scene(result: dict, scene: str, folder: Path) -> None:
    """A panel per law (rows) and damping (columns)."""
    names = [name for name, about in result["problems"].items() if about["figure"] == scene]
    laws = list(dict.fromkeys(name.partition("/")[0] for name in names))
    dampings = list(dict.fromkeys(name.partition("/")[2] for name in names))
    rows = [row for row in result["rows"] if row["problem"] in names]
    figure, grid = plt.subplots(len(laws), len(dampings), figsize=(4.4 * len(dampings), 3.6 * len(laws) + 1.6), sharex=True,
                                sharey=True, squeeze=False, layout="constrained")  # fmt: skip
    for name in names:
        law, _, damping = name.partition("/")
        about, axes = result["problems"][name], grid[laws.index(law), dampings.index(damping)]
        _panel(axes, [row for row in rows if row["problem"] == name], _floor(about))
        axes.set_title(f"{about['title']}, {plural(about['transitions'], 'transition')}", fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("largest error of the top nodes, m")
    for axes in grid[:, 0]:
        axes.set_ylabel("ms per simulated second")
    figure.suptitle(f"{scene}, pushed for 1 s: time against error (grey: beyond the reference's own accuracy)", fontsize=10)
    _legend(figure, rows, max(2, 2 * len(dampings) - 1))
    _store(figure, folder, scene)


def _single(result: dict, name: str, quantities: dict[str, str], title: str, folder: Path) -> None:
    """A panel per measure of error of one problem; quantities: column -> axis label."""
    about = result["problems"][name]
    rows = [row for row in result["rows"] if row["problem"] == name]
    figure, grid = plt.subplots(1, len(quantities), figsize=(6.0 * len(quantities), 5.8), sharey=True, squeeze=False,
                                layout="constrained")  # fmt: skip
    for axes, (quantity, text) in zip(grid[0], quantities.items()):
        _panel(axes, rows, _floor(about), quantity)
        axes.set_xlabel(text)
    grid[0, 0].set_ylabel("ms per simulated second")
    figure.suptitle(title, fontsize=10)
    _legend(figure, rows, 2 * len(quantities))
    _store(figure, folder, about["figure"])


def names(result: dict) -> list[str]:
    """Of the figures that the data hold, in order."""
    return list(dict.fromkeys(about["figure"] for about in result["problems"].values()))


def draw(result: dict, folder: Path) -> None:
    """All figures."""
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "work_precision", "font.size": 8})
    nodes = {"error": "largest error of the nodes, m"}
    for name in names(result):
        if name == "free_flight":
            quantities = nodes | {"energy_error": "largest error of the energy, relative"}
            _single(result, name, quantities, "free flight, 100 s without dampers: time against error", folder)
        elif name == "mujoco":
            _single(result, "mujoco_prism", nodes, "tumbling prism, 1 s without dampers: time against error", folder)
        else:
            _scene(result, name, folder)
