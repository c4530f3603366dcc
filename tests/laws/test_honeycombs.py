"""The exact law of beams in series against known values, an independent bisection, quadrature and differences."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

from tensegrity_core.errors import InputError
from tensegrity_core.laws import law
from tensegrity_core.laws.beam import beam_displacement, beam_energy, beam_extrema, beam_force, root
from tensegrity_core.laws.curves import HeldCurve
from tensegrity_core.laws.panels import ACCURACY
from tensegrity_core.laws.pieces import TIE
from tensegrity_core.model import NSH

ARTICLE = NSH(Q=(6.0, 8.0, 10.0, 12.0), zeta=(3.0, 4.0, 5.0, 6.0), h=(0.01, 0.01, 0.015, 0.01))
K = 5000.0


def beam(Q, zeta, x):
    """Eq. 11 as the article prints it."""
    return Q * (zeta * x**3 - 3.0 * zeta * x**2 + 2.0 * (1.0 + zeta) * x)


def bisect_root(Q, zeta, f, low, high):
    """x in [low, high] with beam = f, by plain bisection."""
    sign = math.copysign(1.0, beam(Q, zeta, high) - beam(Q, zeta, low))
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sign * (beam(Q, zeta, middle) - f) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def algorithm_1(n: NSH, f: float, already_snapped: set[int]) -> float:
    """Elongation on a rise, m: beams that have snapped on III (at 2h beyond 4Q), the others on I."""
    total = 0.0
    for i, (Q, zeta, h) in enumerate(zip(n.Q, n.zeta, n.h)):
        s = math.sqrt((zeta - 2.0) / (3.0 * zeta))
        if i not in already_snapped:
            total += h * bisect_root(Q, zeta, f, 0.0, 1.0 - s)
        else:
            total += 2.0 * h if f >= 4.0 * Q else h * bisect_root(Q, zeta, f, 1.0 + s, 2.0)
    return total


def displacements(n: NSH, xi: float) -> np.ndarray:
    """(n,) m: each beam's place at an elongation on a piece, under the force there."""
    made = law(n.element, K)
    piece = made.pieces[made.piece_of(xi) - 1]
    order = sorted(range(len(n.Q)), key=lambda i: beam_extrema(n.Q[i], n.zeta[i], n.h[i]).f_max)
    past = set(order[: piece.snapped])
    steepest = max(2.0 * Q * (1.0 + zeta) / h for Q, zeta, h in zip(n.Q, n.zeta, n.h))
    f, u = made.force(piece.start if isinstance(piece.curve, HeldCurve) else xi), np.zeros(len(n.Q))
    for i, (Q, zeta, h) in enumerate(zip(n.Q, n.zeta, n.h)):
        u[i] = min(h * root(f / Q, zeta, "III" if i in past else "I"), 2.0 * h)
        felt = 1e-14 * f + 2.0 * np.spacing(xi) * steepest  # an ulp of xi is felt; where it turns, a root has half its digits
        if i not in past and f >= beam_extrema(Q, zeta, h).f_max - felt:
            u[i] = beam_extrema(Q, zeta, h).u_max
    if isinstance(piece.curve, HeldCurve):  # the last of them is on its way
        u[order[piece.snapped - 1]] = 0.0
        u[order[piece.snapped - 1]] = xi - u.sum()
    return u


beams = st.tuples(st.floats(0.5, 50.0), st.floats(2.05, 7.95), st.floats(1e-3, 0.05))
honeycombs = st.lists(beams, min_size=1, max_size=6).map(lambda rows: NSH(*(tuple(c) for c in zip(*rows))))


def test_article_extrema():
    f_max = [beam_extrema(*b).f_max for b in zip(ARTICLE.Q, ARTICLE.zeta, ARTICLE.h)]
    f_min = [beam_extrema(*b).f_min for b in zip(ARTICLE.Q, ARTICLE.zeta, ARTICLE.h)]
    np.testing.assert_allclose(f_max, [13.333, 20.355, 28.944, 39.085], atol=5e-4)
    np.testing.assert_allclose(f_min, [10.667, 11.645, 11.056, 8.915], atol=5e-4)


def test_article_curve():
    for force, centimetres in ((39.0, 7.487), (39.2, 8.934), (48.0, 9.0)):
        assert law(ARTICLE.element).elongation(force) * 100.0 == pytest.approx(centimetres, abs=5e-4)
    made = law(ARTICLE.element, K)
    ends = made.breakpoints
    assert len(ends) == 13 and ends[0] == 0.0 and ends[-1] == pytest.approx(0.09, rel=1e-15)
    # Rises end at f_max, or at 4Q of a beam that has snapped before: 24, 32, 40 and at last 48 N.
    f_max = [beam_extrema(*b).f_max for b in zip(ARTICLE.Q, ARTICLE.zeta, ARTICLE.h)]
    first, second, third, fourth = f_max
    expected = [0.0, first, first, second, second, 24.0, third, third, 32.0, fourth, fourth, 40.0, 48.0]
    np.testing.assert_allclose([made.force(x) for x in ends], expected, rtol=1e-14)
    assert [made.snapped_on_piece(made.piece_of(x + 1e-9)) for x in ends] == [0, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4]
    assert [made.snapped_on_piece(made.piece_of(x)) for x in ends] == [0, 0, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4]


def test_slack_and_bottomed_out():
    made = law(ARTICLE.element, K)
    total = made.end
    for function in (made.force, made.stiffness, made.energy):
        assert function(-0.01) == 0.0 and function(0.0) == 0.0
    assert made.force(total + 0.002) == pytest.approx(48.0 + 0.002 * K, rel=1e-13)
    assert made.stiffness(total + 0.002) == K
    beyond = made.energy(total + 0.002) - made.energy(total)
    assert beyond == pytest.approx(48.0 * 0.002 + 0.5 * K * 0.002**2, rel=1e-12)
    assert made.elongation(58.0) == pytest.approx(total + 10.0 / K, rel=1e-14)
    assert [made.piece_of(x) for x in (-1.0, 0.0, 1e-30, total, total * (1 + 1e-15))] == [0, 0, 1, 12, 13]


def test_snap_follows_its_own_beam_with_the_others_held():
    made = law(ARTICLE.element, K)
    start, end = made.breakpoints[6:8]
    held = start - beam_extrema(10.0, 5.0, 0.015).u_max
    for xi in np.linspace(start, end, 7)[1:-1]:
        assert made.force(xi) == pytest.approx(beam(10.0, 5.0, (xi - held) / 0.015), rel=1e-14)


@settings(max_examples=60, deadline=None)
@given(Q=st.floats(0.5, 50.0), zeta=st.floats(2.01, 7.99), h=st.floats(1e-3, 0.1), part=st.just(0.0) | st.floats(1e-9, 1.0))
def test_beam_roots(Q, zeta, h, part):
    e = beam_extrema(Q, zeta, h)
    between = e.f_min + part * (e.f_max - e.f_min)
    for region, f, low, high in (
        ("I", part * e.f_max, 0.0, e.u_max),
        ("II", between, e.u_max, e.u_min),
        ("III", e.f_min + part * (4.0 * Q - e.f_min), e.u_min, 2.0 * h),
    ):
        u = beam_displacement(Q, zeta, h, f, region)
        assert low * (1 - 1e-14) <= u <= high * (1 + 1e-14)
        # Round-off of the law's own terms (eight operations, and of u what the slope makes of it: eleven halves of an ulp);
        # where they do not cancel (small x) this is round-off of f.
        x = u / h
        terms = Q * (zeta * x**3 + 3.0 * zeta * x**2 + 2.0 * (1.0 + zeta) * x)
        assert abs(beam_force(Q, zeta, h, u) - f) <= 11 * 1.11e-16 * terms
        assert abs(beam(Q, zeta, x) - f) <= 11 * 1.11e-16 * terms
    with pytest.raises(InputError, match="region II"):
        beam_displacement(Q, zeta, h, e.f_max * 1.01, "II")


@settings(max_examples=40, deadline=None)
@given(honeycombs, st.floats(0.0, 1.0))
def test_rises_invert_algorithm_1(n, part):
    """On every rise: f from xi, and xi from f, against plain bisection."""
    made, before = law(n.element, K), 0.0
    order = sorted(range(len(n.Q)), key=lambda i: beam_extrema(n.Q[i], n.zeta[i], n.h[i]).f_max)
    tops = [beam_extrema(n.Q[i], n.zeta[i], n.h[i]).f_max for i in order] + [4.0 * max(n.Q)]
    for count, top in enumerate(tops):
        f = before + (0.001 + 0.998 * part) * (top - before)
        if top > before * 1.001:
            xi = algorithm_1(n, f, set(order[:count]))
            # d(force) = f' d(xi): the bisection's own round-off in xi passes through the stiffness.
            slack = 1e-13 * f + 4e-16 * made.end * made.stiffness(xi)
            assert abs(made.force(xi) - f) <= slack
            assert made.elongation(f) == pytest.approx(xi, rel=1e-9)
            assert abs(made.force(made.elongation(f)) - f) <= slack
            assert made.snapped_on_piece(made.piece_of(xi)) == count
        before = top


@settings(max_examples=30, deadline=None)
@given(honeycombs)
@example(NSH((1.0,) * 5, (3.0, 3.0, 4.5, 4.5, 4.5), (0.03125, 0.03125, 0.0078125, 0.00390625, 0.00390625)))
@example(NSH((39.0, 37.5, 39.0), (7.25, 7.75, 7.25), (0.001953125, 0.03125, 0.015625)))
@example(
    NSH(
        (1.0, 14.0, 14.0, 40.0, 36.18985855665124, 42.483445994769),
        (3.0, 6.0, 6.0, 3.0, 7.0, 4.125),
        (0.03125, 0.001, 0.03125, 0.046875, 0.03125, 0.026966391574177198),
    )
)
def test_curve_is_continuous_and_consistent(n):
    made = law(n.element, K)
    ends = made.breakpoints
    assert (np.diff(ends) > 0.0).all() and ends[-1] == pytest.approx(2.0 * sum(n.h), rel=1e-14)
    scale, steepest = 4.0 * max(n.Q), max(2.0 * Q * (1.0 + zeta) / h for Q, zeta, h in zip(n.Q, n.zeta, n.h))
    for p in range(1, len(ends)):
        here, slack = made.force(ends[p]), 1e-13 * scale + 2.0 * np.spacing(ends[p]) * steepest  # an ulp of xi is felt
        assert abs(made.force_on_piece(p, ends[p]) - here) <= slack
        assert abs(made.force_on_piece(p + 1, ends[p]) - here) <= slack
        for xi in ends[p - 1] + np.array([0.17, 0.52, 0.86]) * (ends[p] - ends[p - 1]):
            u = displacements(n, xi)
            assert u.sum() == pytest.approx(xi, rel=1e-14, abs=4e-16 * scale / abs(made.stiffness(xi)))
            stored = sum(beam_energy(*b, x) for *b, x in zip(n.Q, n.zeta, n.h, u))
            felt = 4e-16 * scale**2 / abs(made.stiffness(xi)) + TIE * made.force(ends[p - 1]) * xi  # forces that tie are one
            assert (
                abs(made.energy(xi) - stored) <= 1e-14 * stored + felt
            )  # round-off of the energies, and of where the beams are
            step = 1e-4 * (ends[p] - ends[p - 1])
            slope = (made.force(xi + step) - made.force(xi - step)) / (2.0 * step)
            spread = abs(made.stiffness(xi + step) - made.stiffness(xi - step))
            assert abs(made.stiffness(xi) - slope) <= spread + 1e-13 * scale / step


@pytest.mark.parametrize("n", [ARTICLE, NSH((6.0,), (3.0,), (0.01,)), NSH((5.0,) * 3, (4.0,) * 3, (0.01, 0.02, 0.01))])
def test_energy_is_the_integral_of_force(n):
    made, work = law(n.element, K), 0.0
    for low, high in pairwise(made.breakpoints):
        work += quad(made.force, low, high, epsabs=1e-14, epsrel=1e-13)[0]
        assert made.energy(high) == pytest.approx(work, rel=1e-10)


def test_equal_beams_snap_lowest_index_first():
    n = NSH((6.0, 6.0, 6.0), (3.0, 3.0, 3.0), (0.01, 0.02, 0.01))
    made = law(n.element, K)
    ends = made.breakpoints
    assert len(made.pieces) == 5  # a rise, three snaps, a rise: no pieces of length zero between snaps
    np.testing.assert_allclose(np.diff(ends)[1:4], 3.0 / 3.0 * np.array(n.h), rtol=1e-12)  # of 3 s h, s = 1/3
    # Three equal beams share the elongation, so the series is one beam of the summed height.
    alone = NSH((6.0,), (3.0,), (0.04,))
    xi = np.linspace(0.0, ends[1], 9)
    single = law(alone.element, K)
    np.testing.assert_allclose([made.force(x) for x in xi], [single.force(x) for x in xi], rtol=1e-13)


def test_one_beam_is_eq_11():
    n = NSH((7.0,), (5.5,), (0.012,))
    xi = np.linspace(0.0, 0.024, 41)
    made = law(n.element, K)
    np.testing.assert_allclose([made.force(x) for x in xi], [beam(7.0, 5.5, x / 0.012) for x in xi], rtol=1e-12, atol=1e-14)


def test_continuation_past_a_piece_is_smooth():
    """Second order contact: third differences across the end of a piece are of third order."""
    made = law(ARTICLE.element, K)
    ends = made.breakpoints
    for p in range(1, len(ends)):
        for end, sign in ((ends[p - 1], -1.0), (ends[p], 1.0)):
            step = 1e-6
            f = [made.force_on_piece(p, end + sign * m * step) for m in (-2, -1, 0, 1, 2)]
            third = f[4] - 3.0 * f[3] + 3.0 * f[2] - f[1]
            assert abs(third) < 5e-9, (p, end)  # a jump of slope by 1 N/m would give 1e-6


def test_very_different_beams():
    n = NSH((0.01, 500.0, 3.0), (2.1, 7.9, 5.0), (0.5, 1e-4, 0.02))
    made = law(n.element, K)
    ends = made.breakpoints
    order = sorted(range(3), key=lambda i: n.Q[i])
    f = 100.0
    assert made.force(algorithm_1(n, f, set(order[:2]))) == pytest.approx(f, rel=1e-9)
    xi = ends[0] + 0.5 * ends[1]
    f = made.force(xi)
    independent = brentq(lambda g: algorithm_1(n, g, set()) - xi, 0.0, made.force(ends[1]), xtol=1e-18, rtol=1e-15)
    assert f == pytest.approx(independent, rel=1e-12)


@pytest.mark.parametrize(
    "bad, message",
    [
        (NSH((6.0,), (8.5,), (0.01,)), "a string bears no compression"),
        (NSH((6.0,), (math.nan,), (0.01,)), "beam.zeta = nan"),
        (NSH((-6.0,), (3.0,), (0.01,)), "beam.Q = -6.0"),
        (NSH((6.0,), (3.0,), (math.inf,)), "beam.h = inf"),
        (NSH((6.0, 1.0), (3.0,), (0.01,)), "one value of each per beam"),
        (NSH((), (), ()), "at least one part"),
    ],
)
def test_bad_parameters_are_named(bad, message):
    with pytest.raises(InputError, match=message):
        law(bad.element)


def test_bad_requests():
    with pytest.raises(InputError, match="ends at 48"):
        law(ARTICLE.element).elongation(50.0)
    with pytest.raises(InputError, match="-1.0 N"):
        law(ARTICLE.element).elongation(-1.0)
    assert math.isnan(law(ARTICLE.element, K).force(math.nan))
    with pytest.raises(InputError, match="zeta = 1.5"):
        beam_extrema(6.0, 1.5, 0.01)


@pytest.mark.parametrize("honeycomb", [ARTICLE, NSH((5.0,), (7.9,), (0.02,)), NSH((3.0, 3.0), (3.0, 3.0), (0.03, 0.01))])
def test_the_table_equals_the_exact_force(honeycomb):
    made = law(honeycomb.element, 1000.0)
    for number, (start, end) in enumerate(pairwise(made.breakpoints), 1):
        table = made.on_piece(number)
        for xi in np.linspace(start - 1e-4, end + 1e-4, 157):
            assert abs(table(xi) - made.force_on_piece(number, xi)) <= 5.0 * ACCURACY * 4.0 * max(honeycomb.Q)
