"""One beam of an NSH pulled by one mass: the scalar problem m u'' + d u' + f(u) = F, and the scene that poses it.

The mass is the tip of a pinned bar of 20 m, so long that it moves on a straight line (its end has a third of the bar's mass;
over the beam's 2 cm the arc departs from the line by 1e-5 m, the string's length by 5e-11 m).  An NSH string of one beam
holds the tip from one side.  From the other side pulls either a dead load F (force control), or a plain string whose rest
length is wound in (displacement control), a spring k_s in series with what winds.

About u = h, where the beam's stiffness is most negative, kappa = |f'(h)| = Q (zeta - 2)/h:
    force control: m r^2 + d r - kappa = 0, one root r > 0: sqrt(kappa/m) without damping, kappa/d with much of it
    displacement control: m r^2 + d r + k_s - kappa = 0: stable if and only if k_s > kappa.
In the units h and sqrt(m/kappa) the one parameter left is delta = d / sqrt(m kappa).
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicHermiteSpline

from tensegrity_core.kernel import Kernel
from tensegrity_core.laws import beam as law
from tensegrity_core.model import NSH, Model
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model

#: The last beam of the article's NSH, Q = 12 N, zeta = 6, h = 1 cm: the one with the most negative stiffness.
Q, ZETA, H = 12.0, 6.0, 0.01
BEAM = NSH((Q,), (ZETA,), (H,))
EDGE = law.beam_extrema(Q, ZETA, H)
#: N/m: the most negative stiffness of the beam is -KAPPA, at u = h.
KAPPA = -float(law.beam_stiffness(Q, ZETA, H, H))
#: N/m: stiffness of the string once the beam has bottomed out.
STOP = 5000.0
LEVER, GAP = 20.0, 1.0


class Case(NamedTuple):
    """m (kg) at the tip, d (N s/m) of the NSH string, F (N) on the tip, k_s (N/m) of the winding string, 0 for none."""

    mass: float
    damping: float
    load: float = 0.0
    series: float = 0.0

    @property
    def delta(self) -> float:
        return self.damping / math.sqrt(self.mass * KAPPA)

    @property
    def unit(self) -> float:
        """s: sqrt(m / kappa)."""
        return math.sqrt(self.mass / KAPPA)


def case(mass: float, delta: float, load: float = 0.0, series: float = 0.0) -> Case:
    """A case by its dimensionless damping."""
    return Case(mass, delta * math.sqrt(mass * KAPPA), load, series)


def force(u):
    """f(u), N, of the beam alone and beyond 2h of the string's own stiffness; u in m, float or array."""
    u = np.asarray(u, dtype=float)
    return np.where(u <= 2.0 * H, law.beam_force(Q, ZETA, H, np.maximum(u, 0.0)), 4.0 * Q + STOP * (u - 2.0 * H))


def model_at(c: Case, u: float, held: float | None = None) -> Model:
    """The scene with the beam at u (m), at rest.  held: m, elongation of the winding string there."""
    strings = {"beam": {"nodes": ["wall", "tip"], "stiffness": STOP, "damping": c.damping, "nsh": "one"}}
    rest = {"beam": GAP - u}
    if c.series:
        strings["winder"] = {"nodes": ["tip", "drum"], "stiffness": c.series}
        rest["winder"] = GAP - held
    return build_model(
        parse_scene(
            {
                "name": "one_beam",
                "plane": "xy",
                "gravity": 0.0,
                "start": "released",
                "fixed": ["pin", "wall", "drum"],
                "nodes": {"pin": [0.0, 0.0], "tip": [0.0, LEVER], "wall": [-GAP, LEVER], "drum": [GAP, LEVER]},
                "bars": {"lever": {"nodes": ["pin", "tip"], "mass": 3.0 * c.mass}},
                "nsh": {"one": {"Q": [Q], "zeta": [ZETA], "h": [H]}},
                "strings": strings,
                "prestress": {"rest_length": rest},
            }
        )
    )


class Path(NamedTuple):
    """times (K,) s, u (K,) m and its rate (K,) m/s at them; elastic: (K, S) N, elastic tension of every string."""

    times: np.ndarray
    u: np.ndarray
    rate: np.ndarray
    elastic: np.ndarray


def run(c: Case, u0: float, duration: float, steps: int, held: float | None = None, wind: float = 0.0, **settings) -> Path:
    """The kernel on the case from rest at u0 (m), over equal communication steps.

    wind: m/s, rate at which the winding string is wound in; settings: method, tolerance, max_step of the kernel."""
    model = model_at(c, u0, held)
    kernel = Kernel(model, **({"tolerance": 1e-12} | settings))
    tip = list(model.free_nodes).index(model.node_names.index("tip"))
    at = model.node_names.index("tip") * 2
    kernel["force"][2 * tip] = c.load
    rates = np.where([name == "winder" for name in model.string_names], -wind, 0.0)
    times = np.arange(steps + 1) * (duration / steps)
    rows = np.empty((steps + 1, 2 + len(rates)))

    def record(k):
        rows[k] = [u0 + kernel["position"][at], kernel["velocity"][2 * tip], *kernel["elastic_force"]]

    kernel["rest_length_rate"][:] = rates
    kernel.initialize()
    record(0)
    for k in range(steps):
        kernel["rest_length"][:] = model.rest_length + rates * times[k]
        kernel["rest_length_rate"][:] = rates
        kernel.step(times[k + 1] - times[k])
        record(k + 1)
    return Path(times, rows[:, 0], rows[:, 1], rows[:, 2:])


def crossing(path: Path, level: float) -> float:
    """s: when u first rises through a level (m), on the cubic that has u and its rate at both ends of a step; nan if never."""
    roots = CubicHermiteSpline(path.times, path.u, path.rate).solve(level, extrapolate=False)
    return float(min(roots, default=np.nan))


# -------------------------------------------------------------------------------------------------------------- theory


def growth(delta, ratio=0.0):
    """Largest root r / sqrt(kappa/m) about u = h (its real part); ratio: k_s / kappa."""
    delta, ratio = np.asarray(delta, dtype=float), np.asarray(ratio, dtype=float)
    root = np.sqrt(np.asarray(delta**2 + 4.0 * (1.0 - ratio), dtype=complex)).real
    # in this form nothing cancels where delta is large
    return np.where(root > 0.0, 2.0 * (1.0 - ratio) / (delta + root), -0.5 * delta)


@cache
def snap_time(delta: float, overload: float) -> float:
    """Time on branch II, from rest at u_max to u_min, in sqrt(m/kappa), under the dead load (1 + overload) f_max."""
    load = EDGE.f_max * (1.0 + overload)

    def f(t, y):
        return [y[1], (load - float(force(H * y[0]))) / (KAPPA * H) - delta * y[1]]

    def arrived(t, y):
        return y[0] - EDGE.u_min / H

    arrived.terminal, arrived.direction = True, 1.0
    longest = 10.0 * (snap_time_undamped(overload) + delta * snap_time_overdamped(overload))
    found = solve_ivp(f, (0.0, longest), [EDGE.u_max / H, 0.0], method="LSODA", rtol=1e-11, atol=1e-13, events=arrived)
    return float(found.t_events[0][0])


#: Second derivative of f at u_max, N/m2, and its third everywhere, N/m3: exactly,
#: F - f(u_max + w) = (F - f_max) - BEND w^2/2 - TWIST w^3/6.
TWIST = 6.0 * Q * ZETA / H**3
BEND = TWIST * (EDGE.u_max - H)
REACH = EDGE.u_min - EDGE.u_max


def snap_time_undamped(overload: float) -> float:
    """The same without damping: integral of du / sqrt(2/m integral of (F - f)), in sqrt(m/kappa)."""
    spare = overload * EDGE.f_max

    def integrand(s):  # u = u_max + s^2 takes the singularity at the start away
        w = s * s
        return 2.0 * math.sqrt(0.5 * KAPPA / (spare - w * w * (BEND / 6.0 + TWIST * w / 24.0)))

    bend = (6.0 * spare / -BEND) ** 0.25
    return quad(integrand, 0.0, math.sqrt(REACH), limit=500, epsrel=1e-10, points=[min(bend, 0.5 * math.sqrt(REACH))])[0]


def snap_time_overdamped(overload: float) -> float:
    """The same for d u' = F - f(u), in d/kappa: integral of kappa du / (F - f)."""
    spare = overload * EDGE.f_max

    def integrand(w):
        return KAPPA / (spare - w * w * (BEND / 2.0 + TWIST * w / 6.0))

    bend = math.sqrt(2.0 * spare / -BEND)
    return quad(integrand, 0.0, REACH, limit=500, epsrel=1e-10, points=[min(bend, 0.5 * REACH)])[0]


def jump_under_winding(series: float) -> tuple[float, float, float, float]:
    """Where a slow winder with k_s < kappa snaps: u and load where f'(u) = -k_s, u and load where the line of slope -k_s
    from there meets the curve again (m, N, m, N)."""
    curvature = 3.0 * Q * ZETA / H**3
    leaves = H - math.sqrt((KAPPA - series) / curvature)
    lands = H + 2.0 * (H - leaves)  # a cubic: the tangent at h - a meets it again at h + 2a
    return leaves, float(force(leaves)), lands, float(force(lands))
