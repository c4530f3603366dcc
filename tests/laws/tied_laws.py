"""Honeycombs whose beams tie, exactly or nearly, and what Algorithm 1 says of them, in 40 digits.

What is right at a tie.  Forces within TIE of each other are one: beams whose maxima tie come to them together, each to its own,
and snap the lowest index first; beams whose stops tie come to rest together.  So a law depends on its parameters through
round-off in a continuous way, though the exact law has a square root there: a beam whose maximum is 1e-16 higher stands 1e-8 of
its height before it when the other snaps.  Beyond TIE the exact law holds.

At the edge of TIE the law is two: which beam snaps first may change there.  A double knows a maximum to about one unit of
round-off, so that where two of them are apart by TIE and less than ROUND_OFF more or less, either law is right, and no other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Decimal, getcontext
from itertools import product
from typing import NamedTuple

import numpy as np

from tensegrity_core import laws
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import NSH
from tests.support.words import words

getcontext().prec = 40
TIE, ROUND_OFF = 32 * 2.0**-52, 4 * 2.0**-52  # of the force; of a maximum as computed, and some
HALF, ONE, TWO, THREE, FOUR = (Decimal(v) for v in ("0.5", 1, 2, 3, 4))
#: Distances of ties: ulps, or parts.
DISTANCES = (0, 1, 2, 4, 31, 32, 33, 100, 1e-12, 1e-9)


def apart(value: float, distance: float, side: int) -> float:
    """A value at one of DISTANCES beside another, above (side 1) or below (-1)."""
    if distance >= 1:
        for _ in range(int(distance)):
            value = math.nextafter(value, side * math.inf)
        return value
    return value * (1.0 + side * distance)


def swing(zeta: float) -> float:
    """f_max/(2 Q) - 1."""
    return (zeta - 2.0) * math.sqrt((zeta - 2.0) / (3.0 * zeta)) / 3.0


def extremum(kind: str, zeta: float) -> float:
    """f_max/(2 Q) or f_min/(2 Q); kind: 'max' or 'min'."""
    return 1.0 + swing(zeta) if kind == "max" else 1.0 - swing(zeta)


def tied(random: np.random.Generator, distance: float) -> NSH:
    """A honeycomb of 2 to 12 beams, some of which tie at a distance: maxima, minima, stops, a stop and a maximum, or all."""
    n = int(random.integers(2, 13))
    Q, zeta, h = random.uniform(0.5, 20.0, n), random.uniform(2.05, 7.95, n), random.uniform(1e-3, 0.05, n)
    group = random.permutation(n)[: random.integers(2, n + 1)]
    first, kind = group[0], random.choice(["max", "min", "stop", "stop of max", "alike", "alike but h", "round"])
    if kind == "round":  # numbers that people type
        Q, zeta = np.round(Q) + 1.0, np.clip(np.round(zeta), 3.0, 7.0)
        h = np.round(h, 2) + 0.01
    for i in group[1:]:
        side = int(random.choice([-1, 1]))
        if kind in ("max", "min"):
            Q[i] = Q[first] * extremum(kind, zeta[first]) / extremum(kind, zeta[i])
        elif kind == "stop of max":
            Q[i] = 0.5 * Q[first] * (1.0 + swing(zeta[first]))
        else:
            Q[i] = Q[first]
        if kind.startswith("alike"):
            zeta[i] = zeta[first] if random.random() < 0.7 else apart(zeta[first], distance, side)
            if kind == "alike":
                h[i] = h[first] if random.random() < 0.5 else apart(h[first], distance, side)
        if random.random() < 0.8:
            Q[i] = apart(Q[i], distance, side)
    return NSH(tuple(Q.tolist()), tuple(zeta.tolist()), tuple(h.tolist()))


class Beam(NamedTuple):
    """Eq. 11 in 40 digits; x_max, f_max: its maximum."""

    Q: Decimal
    zeta: Decimal
    h: Decimal
    s: Decimal

    def force(self, x: Decimal) -> Decimal:
        return self.Q * x * (self.zeta * (x * (x - THREE) + TWO) + TWO)

    def slope(self, x: Decimal) -> Decimal:
        """df/dx, N."""
        return self.Q * (self.zeta * (THREE * x * (x - TWO) + TWO) + TWO)

    @property
    def f_max(self) -> Decimal:
        return self.force(ONE - self.s)

    def rising(self, force: Decimal, snapped: bool) -> Decimal:
        """x on region I, or III as far as the stop, by Newton's method in a bracket."""
        low, high = (ONE + self.s, TWO) if snapped else (Decimal(0), ONE - self.s)
        if force >= self.force(high):
            return high
        x = HALF * (low + high)
        for _ in range(150):
            gap = self.force(x) - force
            low, high = (low, x) if gap > 0 else (x, high)
            slope = self.slope(x)
            step = x - gap / slope if slope else low
            new = step if low < step < high else HALF * (low + high)
            if abs(new - x) < Decimal("1e-36"):
                return new
            x = new
        return x


class Sample(NamedTuple):
    """A point of a law: its elongation, m, and force, N; how many beams have snapped (None: it is an end); whether a beam
    snaps; beams' x."""

    xi: float
    force: float
    snapped: int
    snapping: bool


def exact(honeycomb: NSH) -> list[Beam]:
    rows = honeycomb.Q, honeycomb.zeta, honeycomb.h
    return [Beam(*map(Decimal, b), ((Decimal(b[1]) - TWO) / (THREE * Decimal(b[1]))).sqrt()) for b in zip(*rows)]


def edges(honeycomb: NSH) -> Iterator[tuple[float, ...]]:
    """How far off (parts) maxima may be taken to be when ties are judged: not at all; at the edge of TIE up or down, each."""
    tops = [b.f_max for b in exact(honeycomb)]
    at_edge = [any(abs(float(top / other - ONE) - TIE) <= ROUND_OFF for other in tops) for top in tops]
    yield (0.0,) * len(tops)
    if any(at_edge):
        yield from product(*((-ROUND_OFF, ROUND_OFF) if edge else (0.0,) for edge in at_edge))


def samples(honeycomb: NSH, parts=(0.003, 0.31, 0.77, 0.998), off=None) -> tuple[list[Sample], float]:
    """Points of Algorithm 1's law on each of its rises and snaps; and how near (of the force) maxima are that do not tie."""
    beams = exact(honeycomb)
    tops = [b.f_max for b in beams]
    judged = [top * (ONE + Decimal(o)) for top, o in zip(tops, off)] if off else tops
    tied, x, snapped, force, found, gap = ONE + Decimal(TIE), [Decimal(0)] * len(beams), set(), Decimal(0), [], 1.0
    order = sorted(range(len(beams)), key=lambda i: judged[i])

    def at(x, force, snapping):
        xi = sum((b.h * v for b, v in zip(beams, x)), Decimal(0))
        found.append(Sample(float(xi), float(force), len(snapped) + snapping, snapping))

    def rise(end):
        nonlocal x
        stops = sorted({FOUR * beams[i].Q for i in snapped if force < FOUR * beams[i].Q < end})
        for a, b in zip([force, *stops], [*stops, end]):
            if b <= a * tied:
                continue
            for part in parts:
                here = a + Decimal(part) * (b - a)
                at([one.rising(here, i in snapped) for i, one in enumerate(beams)], here, False)
        x = [one.rising(end, i in snapped) for i, one in enumerate(beams)]

    while order:
        lowest = tops[order[0]]
        group = sorted(i for i in order if judged[i] <= judged[order[0]] * tied)
        order = [i for i in order if i not in group]
        if order:
            gap = min(gap, abs(float(tops[order[0]] / lowest - ONE)))
        rise(lowest)
        for i in group:
            x[i] = ONE - beams[i].s
        for i in group:
            start, end = ONE - beams[i].s, ONE + TWO * beams[i].s
            for part in parts:
                here = start + Decimal(part) * (end - start)
                at([here if j == i else v for j, v in enumerate(x)], beams[i].force(here), True)
            x[i] = end
            snapped.add(i)
        force = max(tops[i] for i in group)
    rise(FOUR * max(b.Q for b in beams))
    return found, gap


def truths(honeycomb: NSH, k: float) -> dict:
    """Force (N) and stiffness (N/m) at an elongation (m): of `laws`, and of the kernel for an NSH and for its element."""
    from tests.kernel.test_kernel_laws import mast

    made = laws.law(honeycomb.element, k)
    beams, element = Kernel(mast(k, nsh=honeycomb)), Kernel(mast(k, element=honeycomb.element))
    return {
        "laws": lambda x: (made.force(x), made.stiffness(x)),
        "kernel": lambda x: beams.string_law(1, x)[:2],
        "kernel, element": lambda x: element.string_law(1, x)[:2],
    }


def check(honeycomb: NSH, parts=(0.31, 0.998)) -> int:
    """Assert that all truths give Algorithm 1's forces, each of one of the laws that `edges` allows; how many points were
    looked at.

    Where maxima are nearer than round-off squared, but no tie, an ulp of the force is 1/sqrt(distance) ulps of the elongation.
    """
    left, wrong, looked = truths(honeycomb, 5000.0), {}, 0
    for off in edges(honeycomb):
        found, gap = samples(honeycomb, parts, off)
        looked = looked or len(found)
        wrong = {name: check_one(honeycomb, name, law, found, gap) for name, law in left.items()}
        left = {name: law for name, law in left.items() if wrong[name]}
        if not left:
            break
    assert not left, wrong
    return looked


def check_one(honeycomb: NSH, name: str, law, points: list[Sample], gap: float) -> str:
    """Where a law is off the points of `samples`, in words; "" if nowhere."""
    size, height = 4.0 * max(honeycomb.Q), sum(honeycomb.h)
    for point in points:
        force, stiffness = law(point.xi)
        allowed = 2e-12 * size + abs(stiffness) * height * (2e-15 + 4e-15 / math.sqrt(max(gap, TIE)))
        if name.startswith("kernel"):  # leaves out rises that are narrower than this part of the elongation
            allowed += 1e-12 * abs(stiffness) * point.xi
        if abs(force - point.force) > allowed:
            return repr((name, point, force, stiffness, gap, honeycomb))
    return ""


if __name__ == "__main__":
    count, further = words(__doc__, int, seeds=[])  # further numbers seed other honeycombs
    looked, base = 0, [int(seed) for seed in further]
    for seed in range(count):
        looked += check(tied(np.random.default_rng([seed, *base] if base else seed), DISTANCES[seed % len(DISTANCES)]))
    print(f"{count} honeycombs that tie, {looked} points, each of 3 laws: all within round-off of 40 digits")
