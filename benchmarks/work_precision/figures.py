"""Figures of the work-precision benchmark, from its data.

Our methods are drawn one by one.  The others are drawn as what is best of each family, over its ladders, which stand faint
behind.
"""

from __future__ import annotations

from functools import partial

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.harness.page import new_figure

from .data import front, grouped

OWN = {"auto": "#000000", "dop853": "#d62728", "rodas5p": "#1f4fd8", "radau9": "#8e24aa", "rk4": "#e08a00", "ros2": "#00897b"}
#: For a method of the kernel that is not listed above.
OTHER = "#e377c2"
#: What is drawn together: label -> colour, line style, marker.
FAMILIES = {
    "SUNDIALS CVODE BDF": ("#3f6f9f", "-", "s"),
    "SUNDIALS CVODE Adams": ("#3f6f9f", "--", "o"),
    "SUNDIALS ARKODE explicit": ("#5f8f4f", "-", "^"),
    "SUNDIALS ARKODE implicit": ("#5f8f4f", "--", "v"),
    "SUNDIALS, transitions not located": ("#6f7f8f", ":", "D"),
    "SciPy": ("#b5763f", "-", "s"),
    "SciPy, transitions not located": ("#b5763f", ":", "o"),
    "article's equations in NumPy, SciPy": ("#7a6a4f", "-.", "P"),
    "MuJoCo Euler and implicit": ("#7f7f7f", "--", "o"),
    "MuJoCo RK4": ("#4f4f4f", "-", "D"),
}
#: Largest error shown, m; a structure is as large.  Runs of fixed step beyond UNSTABLE, m, are near their stability limit and
#: stand by themselves.
SHOWN, UNSTABLE = 1.0, 0.1
CUT = "tighter settings: beyond the time limit"


def family(row: dict, smooth: bool) -> str:
    """What a peer's run is drawn with; smooth: the problem has no transitions to locate."""
    maker, method = row["family"], row["method"]
    located = row["events"] or smooth
    if maker == "mujoco":
        return "MuJoCo RK4" if method == "RK4" else "MuJoCo Euler and implicit"
    if maker == "article":
        return "article's equations in NumPy, SciPy"
    if maker == "scipy":
        return "SciPy" if located else "SciPy, transitions not located"
    if not located:
        return "SUNDIALS, transitions not located"
    if method.startswith("cvode"):
        return "SUNDIALS CVODE BDF" if method == "cvode_bdf" else "SUNDIALS CVODE Adams"
    return "SUNDIALS ARKODE explicit" if method.startswith("erk") else "SUNDIALS ARKODE implicit"


def plural(count: int, word: str) -> str:
    return f"{count or 'no'} {word}" + ("" if count == 1 else "s")


def own_style(method: str) -> dict:
    return {"color": OWN.get(method, OTHER), "lw": 2.8 if method == "auto" else 1.4, "marker": "o", "ms": 2.8, "zorder": 5}


def family_style(name: str) -> dict:
    colour, line, marker = FAMILIES[name]
    return {"color": colour, "ls": line, "lw": 1.1, "marker": marker, "ms": 2.6, "mew": 0.6, "zorder": 4}


def shown(rows: list[dict], quantity: str) -> list[dict]:
    return [row for row in rows if row.get(quantity) and row["ms_per_s"] and row[quantity] <= SHOWN]


class Panel:
    """The runs of one problem, by one measure of error."""

    def __init__(self, axes, result: dict, problem: str, quantity: str = "error"):
        smooth = result["problems"][problem]["smooth"]
        rows = shown([row for row in result["rows"] if row["problem"] == problem], quantity)
        self.axes, self.quantity = axes, quantity
        self.floor = reference_floor(result["problems"][problem]) if quantity == "error" else 0.0
        self.own = grouped([row for row in rows if row["family"] == "kernel"], lambda row: row["method"])
        peers = [row for row in rows if row["family"] != "kernel"]
        self.families = grouped(peers, lambda row: family(row, smooth))
        self.errors = [row[quantity] for row in rows]

    def draw(self) -> None:
        for method, rows in self.own.items():
            joined = [row for row in rows if row["kind"] == "tolerance" or row[self.quantity] <= UNSTABLE]
            self._line(joined, **own_style(method))
            self._line([row for row in rows if row not in joined], **own_style(method) | {"ls": ""})
            self._end(joined[-1:], own_style(method))
        for name, rows in self.families.items():
            for ladder in grouped(rows, lambda row: (row["family"], row["method"], row["events"])).values():
                self._line(ladder, color=FAMILIES[name][0], lw=0.5, alpha=0.3, zorder=1)
            best = front(rows, self.quantity)
            self._line(best, **family_style(name))
            self._end(best[-1:], family_style(name))

    def _line(self, rows: list[dict], **drawn) -> None:
        self.axes.plot([row[self.quantity] for row in rows], [row["ms_per_s"] for row in rows], **drawn)

    def _end(self, last: list[dict], drawn: dict) -> None:
        """An open mark where the time limit ends a line."""
        if last and last[0]["cut"]:
            self._line(last, **cut_style(drawn["color"]))


def cut_style(colour: str) -> dict:
    return {"color": colour, "ls": "", "marker": "<", "ms": 7.0, "mfc": "white", "mew": 1.0, "zorder": 6}


def finish(panels: list[Panel]) -> None:
    """Draw, and give all panels the same limits; shaded: below what is known of the reference itself."""
    errors = [error for panel in panels for error in panel.errors]
    left, right = max(0.4 * min(errors), 1e-15), 2.5 * max(errors)
    for panel in panels:
        panel.draw()
        panel.axes.set(xscale="log", yscale="log", xlim=(left, right))
        panel.axes.minorticks_off()
        if panel.floor > left:
            panel.axes.axvspan(left, panel.floor, color="0.93", lw=0, zorder=0)


def legend(figure: Figure, panels: list[Panel], columns: int) -> None:
    """Of everything that a panel shows."""
    own = [method for method in (*OWN, *_others(panels)) if any(method in panel.own for panel in panels)]
    families = [name for name in FAMILIES if any(name in panel.families for panel in panels)]
    handles = [Line2D([], [], label=f"our {method}", **own_style(method)) for method in own]
    handles += [Line2D([], [], label=name, **family_style(name)) for name in families]
    if any(line.get_marker() == "<" for panel in panels for line in panel.axes.lines):
        handles.append(Line2D([], [], label=CUT, **cut_style("0.3")))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=7.5, frameon=False)


def _others(panels: list[Panel]) -> list[str]:
    return sorted({method for panel in panels for method in panel.own} - set(OWN))


def reference_floor(about: dict) -> float:
    """Where the reference itself ends, m: how far the nearest other method is from it."""
    return min(about["reference_difference"].values())


def scene_figure(result: dict, scene: str) -> Figure:
    """A panel per law (rows) and damping (columns)."""
    names = [name for name, about in result["problems"].items() if about["figure"] == scene]
    laws = list(dict.fromkeys(name.partition("/")[0] for name in names))
    dampings = list(dict.fromkeys(name.partition("/")[2] for name in names))
    figure = new_figure(2.0 + 3.1 * len(dampings), 1.6 + 2.9 * len(laws))
    grid = figure.subplots(len(laws), len(dampings), sharex=True, sharey=True, squeeze=False)
    panels = []
    for name in names:
        law, _, damping = name.partition("/")
        about, axes = result["problems"][name], grid[laws.index(law), dampings.index(damping)]
        panels.append(Panel(axes, result, name))
        axes.set_title(f"{about['title']}, {plural(about['transitions'], 'transition')}", fontsize=8.5)
    finish(panels)
    for axes in grid[-1]:
        axes.set_xlabel("largest error of the top nodes, m")
    for axes in grid[:, 0]:
        axes.set_ylabel("ms per simulated second")
    figure.suptitle(f"{scene}, pushed for 1 s: time against error", fontsize=9.5)
    legend(figure, panels, max(2, len(dampings) + 1))
    return figure


def single_figure(result: dict, name: str, quantities: dict[str, str], title: str) -> Figure:
    """A panel per measure of error of one problem; quantities: column -> axis label."""
    figure = new_figure(1.0 + 4.8 * len(quantities), 5.4)
    grid = figure.subplots(1, len(quantities), sharey=True, squeeze=False)[0]
    panels = [Panel(axes, result, name, quantity) for axes, quantity in zip(grid, quantities)]
    for panel, label in zip(panels, quantities.values()):
        finish([panel])
        panel.axes.set_xlabel(label)
    grid[0].set_ylabel("ms per simulated second")
    figure.suptitle(title, fontsize=9.5)
    legend(figure, panels, 2 * len(quantities))
    return figure


def names(result: dict) -> list[str]:
    """Of the figures that the data hold, in order."""
    return list(dict.fromkeys(about["figure"] for about in result["problems"].values()))


def figure_of(result: dict, name: str) -> Figure:
    nodes = {"error": "largest error of the nodes, m"}
    if name == "free_flight":
        quantities = nodes | {"energy_error": "largest error of the energy, relative"}
        return single_figure(result, name, quantities, "free flight, 100 s without dampers: time against error")
    if name == "mujoco":
        return single_figure(result, "mujoco_prism", nodes, "tumbling prism, 1 s without dampers: time against error")
    return scene_figure(result, name)


def drawn(result: dict, name: str) -> Figure | None:
    """None where the data hold none of its problems."""
    return figure_of(result, name) if name in names(result) else None


#: Of a full run.
FIGURES = {f"work_precision_{n}": partial(drawn, name=n) for n in ("two_bar", "three_bar", "six_bar", "free_flight", "mujoco")}
