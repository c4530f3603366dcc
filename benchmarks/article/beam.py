"""Draws docs/figures/beam.png, what Q, zeta and h of a beam are (eq. 11 and 14): python -m benchmarks.article.beam [FILE]"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.harness.page import COLOURS, DOCS, new_figure, save, style
from tensegrity_core.laws.beam import beam_extrema, beam_force

Q, ZETA, H = 10.0, 6.0, 0.01  # N, 1, m
INK, RED, TEAL = COLOURS[:3]


def draw(path: Path) -> None:
    """Write the figure: the curve, its extrema and regions, and where the three parameters are read off."""
    u = np.linspace(0.0, 2.0 * H, 400)
    u_max, f_max, u_min, f_min = beam_extrema(Q, ZETA, H)
    with style():
        figure = new_figure(6.6, 3.9)
        axes = figure.subplots()
        axes.axvspan(u_max / H, u_min / H, color=RED, alpha=0.08)
        axes.plot(u / H, beam_force(Q, ZETA, H, u) / Q, color=INK, linewidth=2.0)
        for x, text in ((u_max / H / 2.0, "I"), (1.0, "II\nstiffness is negative"), (1.0 + u_min / H / 2.0, "III")):
            axes.text(x, 4.55, text, ha="center", va="top", color=RED if "II\n" in text else INK)
        for x, f, name, above in ((u_max / H, f_max / Q, "$f_{max}$", 0.14), (u_min / H, f_min / Q, "$f_{min}$", -0.34)):
            axes.plot(x, f, "o", color=RED, markersize=6)
            axes.text(x, f + above, name, ha="center", color=RED)
        for x, f, name in ((1.0, 2.0, "$(h,\\ 2Q)$"), (2.0, 4.0, "$(2h,\\ 4Q)$")):
            axes.plot([0.0, x, x], [f, f, 0.0], ":", color=TEAL)
            axes.plot(x, f, "s", color=TEAL, markersize=6)
            axes.text(x - 0.05 if x > 1.5 else x + 0.06, f + 0.12, name, ha="right" if x > 1.5 else "left", color=TEAL)
        slope = 2.0 - ZETA
        x = np.array([0.83, 1.17])
        axes.plot(x, 2.0 + slope * (x - 1.0), "--", color=TEAL, linewidth=1.6)
        axes.text(0.94, 1.4, "slope $Q\\,(2-\\zeta)/h$", ha="right", color=TEAL)
        axes.set(xlabel="displacement $u$ / $h$", ylabel="force $f$ / $Q$", xlim=(0.0, 2.1), ylim=(0.0, 4.7))
        save(figure, path)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=DOCS / "figures" / "beam.png")
    draw(parser.parse_args(arguments).file)


if __name__ == "__main__":
    main()
