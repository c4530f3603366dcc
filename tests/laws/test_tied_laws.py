"""Laws of parts that tie, exactly or nearly, against 40 digits (tied_laws.py): the exact laws in Python and the kernel's
curves.

More of them: ``python -m tests.laws.tied_laws 2000``.
"""

from itertools import pairwise

import numpy as np
import pytest

from tensegrity_core.kernel import Kernel
from tensegrity_core.laws import law
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.laws.hysteresis import follow, start
from tensegrity_core.model import NSH
from tensegrity_core.model.elements import Beam, Series, Spring, Table
from tests.kernel.test_kernel_laws import mast, walk
from tests.laws import tied_memory
from tests.laws.tied_laws import DISTANCES, check, tied


@pytest.mark.parametrize("distance", DISTANCES)
def test_honeycombs_that_tie_follow_algorithm_1(distance):
    for seed in range(3):
        check(tied(np.random.default_rng([seed, DISTANCES.index(distance)]), distance))


def test_beams_that_tie_to_round_off():
    """A case that hypothesis found: the stops of two beams differ by one ulp."""
    check(NSH((1.0, 0.5, 0.5000000000000001), (3.0, 3.0, 3.0), (0.03125, 0.03125, 0.03125)))


def test_a_follower_at_its_maximum():
    """Stops that tie and, 1e-12 of the force above, a maximum: there the follower is softer than the leader of the rise."""
    Q, low, high = [14.64952478898343, 9.40434054618254], 8.861776183391164, 8.861776183391282
    zeta = [2.837691499471321, 7.369742738313393, 6.387594067552713, 3.6277594719439543, 6.916991270653321, 6.294031474475433]
    zeta += [5.031281262691017, 3.833453979151656, 7.791734308774152, 6.503089877599897]
    h = (0.012, 0.018, 0.049, 0.01, 0.009, 0.002, 0.0018, 0.027, 0.027, 0.0044)
    assert check(NSH((low, high, high, Q[0], low, high, high, Q[1], high, high), tuple(zeta), h), (0.31, 0.77, 0.998)) > 50


@pytest.mark.parametrize("seed", [216, 230])
def test_rises_between_maxima_that_nearly_tie(seed):
    """Rises of 1e-9 of the force, at the end of which other parts' maxima tie with the leader's: there dx/du is round-off."""
    check(tied(np.random.default_rng(seed), 1e-9))


@pytest.mark.parametrize("kind", ["zeta", "Q"])
def test_a_near_tie_is_a_tie(kind):
    """Beams of different shape whose maxima tie: by the last bits of a parameter neither the order nor the law changes."""
    first, K = NSH((6.0, 5.0, 8.0), (3.0, 6.0, 4.0), (0.01, 0.02, 0.015)), 5000.0
    f_max = [beam_extrema(*beam).f_max for beam in zip(first.Q, first.zeta, first.h)]
    Q = tuple(q * f_max[0] / f for q, f in zip(first.Q, f_max))
    x = np.linspace(0.0, 0.09, 200)
    equal = law(NSH(Q, first.zeta, first.h).element, K)
    expected = [equal.force(v) for v in x]
    for ulps in (-4, -1, 1, 4):
        rows = {"Q": list(Q), "zeta": list(first.zeta), "h": first.h}
        rows[kind][1] *= 1.0 + ulps * 2.0**-53
        near = NSH(*(tuple(rows[name]) for name in ("Q", "zeta", "h")))
        made = law(near.element, K)
        assert made.pieces[1].curve.part == (near.Q[0], near.zeta[0], near.h[0])  # which snaps first
        np.testing.assert_allclose([made.force(v) for v in x], expected, rtol=0.0, atol=1e-12)


#: Beside a beam: what comes to the same force 14.11 N as it does, at a maximum of another shape or where it goes on rising.
BLUNT = Beam(4.248520001508309, 6.17588797237592, 0.026223207239620048)
SHARP = Beam(4.992759597286283, 4.809578772682942, 0.01845639133093147)  # f_max as that of BLUNT, to an ulp
KINK = Table((0.0, 0.01, 0.03), (0.0, 14.112163790171294, 30.0))


@pytest.mark.parametrize(
    "parts, k",
    [
        ((BLUNT, SHARP), 12000.0),
        ((SHARP, BLUNT), 12000.0),
        ((SHARP, BLUNT), 900.0),
        ((Series((BLUNT, Spring(700.0))), SHARP), 12000.0),  # after its snap it bears the force at which the other falls
        ((KINK, SHARP), 12000.0),
        ((BLUNT, KINK), 3000.0),
    ],
)
def test_with_memory_the_kernel_follows_ties_as_the_exact_law(parts, k):
    element = Series(parts, "hysteretic")
    turns = np.array([0.0, 0.2, -0.02, 0.09, 0.03, 0.2])
    sweep = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(turns)])
    force, _, loss, _ = walk(Kernel(mast(k, element=element)), sweep)
    branch = start(element, k)
    for x, found, lost in zip(sweep.tolist(), force, loss):
        branch, events = follow(branch, x)
        assert found == pytest.approx(branch.force(x), abs=1e-7)
        assert lost == pytest.approx(sum(event.loss for event in events), abs=1e-9)


def compared(seed: int, base: int, most: int, fewest: int) -> tuple[str, str]:
    random = np.random.default_rng([seed, base])
    element, k = tied_memory.tied(random, tied_memory.DISTANCES[seed % len(tied_memory.DISTANCES)], most, fewest)
    return tied_memory.compare(element, k, tied_memory.way(random, element))


@pytest.mark.parametrize("seed", [1, 5, 9, 10, 22, 23, 27, 30, 31, 39])
def test_with_memory_both_truths_go_the_same_random_way(seed):
    """Maxima or minima that tie, or are apart by 100 ulps or 1e-12.  More of them: ``python -m tests.laws.tied_memory 48 0
    3``."""
    assert compared(seed, 0, 3, 2) == ("agree", "")


@pytest.mark.parametrize("seed", [10, 12])
def test_with_memory_six_beams_that_tie_go_the_same_way(seed):
    """Minima small beside the beams' largest forces; stops that tie one after the other, the first not with the last."""
    assert compared(seed, 1, 6, 4) == ("agree", "")


@pytest.mark.parametrize("seed", [6, 37])
def test_at_the_edge_of_a_tie_both_truths_stand_on_stable_branches(seed):
    """Ends apart by the tolerance itself: the last bits decide, in each truth by itself, and either is right."""
    assert compared(seed, 0, 3, 2) in {("agree", ""), ("another stable branch, at the edge of a tie", "")}
