"""Series with memory whose beams tie, exactly or nearly, along random ways: the exact law in Python beside the kernel.

``python -m tests.laws.tied_memory [COUNT [SEED [MOST [FEWEST]]]]``, MOST and FEWEST beams.  What is right at a tie, and beyond
it, says `tensegrity_core.laws.hysteresis`.  Both truths go the same way, but at the edge of a tie: where the forces at two ends
are apart by TIE of a stretch's largest force, to within ROUND_OFF of the larger one's, the last bits of either truth decide.
There each must still find an end, lose what its energies say, nothing less than 0, and stand on stable branches of the exact
law.
"""

from __future__ import annotations

import collections
import math
from decimal import Decimal
from itertools import pairwise, product

import numpy as np

from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import Kernel
from tensegrity_core.laws.hysteresis import Branch, follow, memory, start
from tensegrity_core.model import NSH
from tensegrity_core.model.elements import Beam, Series
from tests.laws.tied_laws import FOUR, ONE, TIE, apart, exact, extremum
from tests.support.words import words

#: How far off each truth's force of a minimum may be, as a part of the largest force on the stretches that end there.
ROUND_OFF = 8 * 2.0**-52
#: Distances of ties: ulps (31, 32 and 33 eps of a force among them), or parts.
DISTANCES = (0, 1, 2, 4, 31, 33, 100, 1e-12)


def tied(random: np.random.Generator, distance: float, most: int = 6, fewest: int = 2) -> tuple[Series, float]:
    """A series of `fewest` to `most` beams, some of which tie (maxima, minima, or all), and a string's stiffness, N/m."""
    n = int(random.integers(fewest, most + 1))
    Q, zeta, h = random.uniform(2.0, 10.0, n), random.uniform(2.5, 7.5, n), random.uniform(0.005, 0.03, n)
    group = random.permutation(n)[: random.integers(2, n + 1)]
    first, kind = group[0], random.choice(["max", "min", "alike", "alike but h"])
    for i in group[1:]:
        side = int(random.choice([-1, 1]))
        if kind in ("max", "min"):
            Q[i] = Q[first] * extremum(kind, zeta[first]) / extremum(kind, zeta[i])
        else:
            Q[i], zeta[i] = Q[first], zeta[first]
            if kind == "alike":
                h[i] = h[first]
        if random.random() < 0.8:
            Q[i] = apart(Q[i], distance, side)
    beams = tuple(map(Beam, Q.tolist(), zeta.tolist(), h.tolist()))
    return Series(beams, "hysteretic"), float(random.choice([800.0, 3000.0, 12000.0]))


def way(random: np.random.Generator, element: Series, points: int = 40) -> np.ndarray:
    """Elongations, m, along a random way: a full cycle and turns between."""
    far = 1.3 * sum(2.0 * beam.h for beam in element.parts)
    turns = [0.0, far, -0.01, *(random.uniform(0.0, far, 4)), -0.01]
    return np.concatenate([np.linspace(a, b, points) for a, b in pairwise(turns)])


def apart_in_energy(kernel: Kernel, string: int = 1) -> float:
    """How far (J) the energies of pieces that follow each other are from what the change is said to lose: at most."""
    pieces, worst = kernel.pieces(string), 0.0
    for i, piece in enumerate(pieces):
        for x, after, loss in ((piece.hi, piece.up, piece.loss_up), (piece.lo, piece.down, piece.loss_down)):
            if after >= 0 and np.isfinite(x):
                left = kernel.piece_law(string, i, x)[2] - kernel.piece_law(string, after, x)[2]
                assert loss >= 0.0, (i, loss)
                worst = max(worst, abs(left - loss))
    return worst


def at_an_edge(element: Series) -> bool:
    """Whether round-off decides whether two ends of stretches tie."""
    beams = exact(NSH(*zip(*((beam.Q, beam.zeta, beam.h) for beam in element.parts))))
    ends = []  # force, and the largest forces on the stretches that end there
    for b in beams:
        low = b.force(ONE + b.s)
        ends += [(b.f_max, b.f_max), (low, b.f_max), (low, FOUR * b.Q), (FOUR * b.Q, FOUR * b.Q)]
    tie, off = Decimal(TIE), Decimal(ROUND_OFF)
    return any(abs(abs(a - b) - tie * size) <= off * max(size, other) for a, size in ends for b, other in ends)


def on_a_branch(element: Series, k: float, x: float, force: float) -> float:
    """How far (N) a force at x (m) is from that of the nearest stable branch of the exact law."""
    m = memory(element, k)
    found = [abs(force)] if x <= sum(part.end for part in m.parts) else []  # slack
    for at in product(*(range(len(part.monotone) + 1) for part in m.parts)):
        found += [abs(force - one.force(x)) for one in m.branches(at) if one.lower - 1e-8 <= x <= one.upper + 1e-8]
    return min(found)


def go_on(branch: Branch, x: np.ndarray, force: np.ndarray, near: float, room: float) -> tuple[str, str]:
    """What must hold at the edge of a tie: the exact law goes on from its branch to its end along x (m), losing what its
    energies say to within `room` (J), and the kernel's forces (N) are within `near` of those of stable branches."""
    element, k = branch.memory.element, branch.memory.k
    for v in x.tolist():
        try:
            branch, events = follow(branch, v)
        except TensegrityError as error:
            return "the exact law does not end", str(error)
        for event in events:
            lost = event.before.energy(event.x) - event.after.energy(event.x)
            assert event.loss >= 0.0 and abs(lost - event.loss) <= room, event
    off = max(on_a_branch(element, k, v, found) for v, found in zip(x[::5].tolist(), force[::5]))
    return ("another stable branch, at the edge of a tie", "") if off <= near else ("on no stable branch", f"off {off} N")


def compare(element: Series, k: float, x: np.ndarray) -> tuple[str, str]:
    """Whether both truths go the same way along x (m); what is wrong, if anything.

    Forces and losses may differ by what round-off of the force moves a fold: sqrt(TIE) of the height.
    """
    from tests.kernel.test_kernel_laws import mast, walk

    height, size = 2.0 * sum(beam.h for beam in element.parts), 4.0 * max(beam.Q for beam in element.parts)
    try:
        kernel = Kernel(mast(k, element=element))
    except TensegrityError as error:
        return "the kernel refuses it", str(error)
    force, _, loss, _ = walk(kernel, x)
    energies = apart_in_energy(kernel)
    if energies > 10.0 * math.sqrt(TIE) * size * height:
        return "the kernel's losses are not what its energies say", f"{energies} J"
    branch = start(element, k)
    for v, found, lost in zip(x.tolist(), force, loss):
        try:
            branch, events = follow(branch, v)
        except TensegrityError as error:
            return "the exact law does not end", str(error)
        assert all(event.loss >= 0.0 for event in events)
        if abs(found - branch.force(v)) > 1e-6 * size:
            if at_an_edge(element):
                return go_on(branch, x, force, 1e-6 * size, 10.0 * math.sqrt(TIE) * size * height)
            off = on_a_branch(element, k, v, found)
            return ("another stable branch" if off <= 1e-6 * size else "on no stable branch"), f"x = {v}, {found} N, off {off}"
        if abs(lost - sum(event.loss for event in events)) > 10.0 * math.sqrt(TIE) * size * height:
            return "another loss", f"x = {v}: {lost} J, {sum(event.loss for event in events)} J"
    return "agree", ""


if __name__ == "__main__":
    count, base, most, fewest = words(__doc__, count=100, seed=0, most=6, fewest=2)
    kinds = collections.Counter()
    for seed in range(count):
        random = np.random.default_rng([seed, base])
        distance = DISTANCES[seed % len(DISTANCES)]
        element, k = tied(random, distance, most, fewest)
        kind, note = compare(element, k, way(random, element))
        kinds[kind] += 1
        if note:
            print(f"[{seed}, {base}], distance {distance}, {len(element.parts)} beams: {kind}; {note}", flush=True)
    print(", ".join(f"{kind}: {number}" for kind, number in kinds.items()))
