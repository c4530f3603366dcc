"""Series with memory: closed forms, the internal dynamics integrated by brute force, and what must hold for any series."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp

from tensegrity_core.errors import InputError
from tensegrity_core.laws.hysteresis import follow, start
from tensegrity_core.model.elements import Beam, Parallel, Polynomial, Series, Spring, Table

#: Test 1: a cell of 100 N/m up to 1 N at .01 m, down to .4 N at .02 m, then up again.
CELL = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4))
#: Test 2: the article's NSH.
ARTICLE = tuple(Beam(*beam) for beam in zip((6.0, 8.0, 10.0, 12.0), (3.0, 4.0, 5.0, 6.0), (0.01, 0.01, 0.015, 0.01)))


def series(*parts):
    return Series(tuple(parts), "hysteretic")


def cycle(branch, far):
    """The events on the way from slack to the elongation `far`, and those on the way back."""
    there, up = follow(branch, far)
    _, down = follow(there, -1.0)
    return up, down


def snaps(events):
    return [event for event in events if event.loss > 0.0]


def test_trilinear_cells_in_closed_form():
    up, down = cycle(start(series(CELL, CELL, CELL), 200.0), 0.08)
    np.testing.assert_allclose([e.x for e in snaps(up)], [0.035, 0.051, 0.067], rtol=1e-13)
    np.testing.assert_allclose([e.x for e in snaps(down)], [0.062, 0.046, 0.030], rtol=1e-13)
    for event in snaps(up):
        assert event.before.force(event.x) == pytest.approx(1.0, rel=1e-13)
        assert event.after.force(event.x) == pytest.approx(0.4 + 1.0 / 7.0, rel=1e-13)
    # 1/2 (1 N + .4 N) (.02 m less what the others and the spring give back): 8/7 mJ
    np.testing.assert_allclose([e.loss for e in snaps(up + down)], 8e-3 / 7.0, rtol=1e-12)
    assert sum(e.loss for e in up + down) == pytest.approx(48e-3 / 7.0, rel=1e-12)
    order = [next(i for i in range(3) if e.after.at[i] != e.before.at[i]) for e in snaps(up)]
    assert order == [0, 1, 2]  # ties: the lowest index


def test_article_honeycomb():
    up, down = cycle(start(series(*ARTICLE), 5000.0), 0.11)
    np.testing.assert_allclose([100.0 * e.x for e in snaps(up)], [3.51, 5.84, 8.39], atol=0.01)
    # at the last of a sweep's 25 um steps before the snap; at the fold itself the force has fallen further
    sweep = [e.before.force(math.floor(e.x / 25e-6) * 25e-6) for e in snaps(up)]
    np.testing.assert_allclose(sweep, [19.07, 24.20, 36.71], atol=0.005)
    assert [e.after.snapped for e in snaps(up)] == [2, 3, 4]
    assert len(snaps(down)) == 4
    assert sum(e.loss for e in up + down) == pytest.approx(0.457, abs=5e-4)


def test_article_folds_solve_their_own_equations():
    """At a fold 1/k_s + sum 1/f'_j = 0; the second snap comes where beam 1 leaves its stop (4 Q = 24 N)."""
    branch = start(series(*ARTICLE), 5000.0)
    up, _ = cycle(branch, 0.11)
    first, second, third = (e.before for e in snaps(up))
    assert (first.folds, second.folds, third.folds) == ((False, True), (False, False), (False, True))
    assert second.force(second.upper) == pytest.approx(24.0, rel=1e-13)
    for fold in (first, third):
        u = fold.displacements(fold.upper)
        slopes = [fold.memory.force(i, v)[1] for i, (v, n) in enumerate(zip(u, fold.at)) if n < 3]
        assert 1.0 / 5000.0 + sum(1.0 / f for f in slopes) == pytest.approx(0.0, abs=1e-9)


def force_of(part, u):
    """Eq. 11, and what the other parts used here do."""
    if isinstance(part, Beam):
        x = u / part.h
        return part.Q * (part.zeta * x**3 - 3.0 * part.zeta * x**2 + 2.0 * (1.0 + part.zeta) * x)
    if isinstance(part, Spring):
        return part.k * u
    if isinstance(part, Polynomial):
        return sum(c * u ** (i + 1) for i, c in enumerate(part.coefficients))
    return sum(force_of(one, u) for one in part.parts)


def swept(parts, k, far, c=2e-5):
    """u(t) by the overdamped internal dynamics on a sweep to x = far in 1 s, and on the way back: stops as stiff walls."""
    ends = np.array([2.0 * part.h if isinstance(part, Beam) else math.inf for part in parts])

    def rate(t, u):
        forces = [force_of(part, v) for part, v in zip(parts, u)]
        walls = np.where(u > ends, 1e8 * (u - ends), 0.0)
        return (k * (far * min(t, 2.0 - t) - u.sum()) - np.array(forces) - walls) / c

    options = dict(method="Radau", rtol=1e-6, atol=1e-9, dense_output=True)
    there = solve_ivp(rate, (0.0, 1.0), np.zeros(len(parts)), **options)
    return there.sol, solve_ivp(rate, (1.0, 2.0), there.y[:, -1], **options).sol


MIXED = (Parallel((Beam(9.0, 6.0, 0.01), Spring(100.0))), Polynomial((2000.0, -9e4, 1.4e6)), Beam(7.0, 5.0, 0.012))


#: Equal parts would stay equal in `swept` beyond the point where that is stable.
SIMILAR = (*ARTICLE[1:3], Beam(8.1, 4.0, 0.01), Beam(9.9, 5.0, 0.015))


@pytest.mark.parametrize(
    "parts, k, far",
    [(ARTICLE, 5000.0, 0.094), (MIXED, 1500.0, 0.09), (SIMILAR, 3000.0, 0.1)],
    ids=["article", "mixed", "similar"],
)
def test_against_the_internal_dynamics(parts, k, far):
    slow = swept(parts, k, far)
    branch = start(series(*parts), k)
    ways = cycle(branch, far)
    shares = np.linspace(0.02, 0.99, 98)
    for way, sweep, order in zip(ways, slow, (1, -1)):
        events, seen = [e.x for e in snaps(way)], 0
        for share in shares[::order]:
            x = share * far
            branch, _ = follow(branch, x)
            if min((abs(x - e) for e in events), default=1.0) > 1e-3 * far:  # the sweep lags behind near a snap
                u = sweep(share if order > 0 else 2.0 - share)
                np.testing.assert_allclose(branch.displacements(x), u, rtol=0.0, atol=2e-4 * far)
                seen += 1
        assert events and seen > 90


def test_losses_are_the_area_of_the_loop():
    for parts, k, far in ((ARTICLE, 5000.0, 0.11), (MIXED, 1500.0, 0.1), ((CELL,) * 3, 200.0, 0.08)):
        up, down = cycle(start(series(*parts), k), far)
        area = sum(work(e.after, e.x, n.x) for way in (up, down) for e, n in pairwise(way))
        area += work(up[-1].after, up[-1].x, far) - work(up[-1].after, down[0].x, far)
        assert area == pytest.approx(sum(e.loss for e in up + down), rel=1e-10, abs=1e-13)


def work(branch, a, b):
    """Integral of T from a to b on a branch; x = a + (b - a) sin^2 takes the square roots at its ends away."""
    nodes, weights = leggauss(12)
    angles = np.linspace(0.0, 0.5 * math.pi, 9)
    total = 0.0
    for low, high in pairwise(angles):
        at = 0.5 * (high - low) * (nodes + 1.0) + low
        x = a + (b - a) * np.sin(at) ** 2
        jacobian = (b - a) * np.sin(2.0 * at) * 0.5 * (high - low)
        total += float(np.sum(weights * jacobian * [branch.force(v) for v in x]))
    return total


@pytest.mark.parametrize("k", [1e4, 1e6])
def test_a_stiff_string_passes_a_beam_without_a_snap(k):
    """f' of the beam never falls below -2 500 N/m."""
    beam = Beam(10.0, 6.0, 0.016)
    up, down = cycle(start(series(beam), k), 0.05)
    assert not snaps(up + down)
    branch = start(series(beam), k)
    for u in np.linspace(0.001, 0.0319, 40):
        force = force_of(beam, u)
        branch, _ = follow(branch, u + force / k)
        assert branch.force(u + force / k) == pytest.approx(force, rel=1e-12)
    soft_up, soft_down = cycle(start(series(beam), 500.0), 0.2)
    assert len(snaps(soft_up)) == len(snaps(soft_down)) == 1


def test_force_is_finite_and_continuous_past_a_fold():
    up, _ = cycle(start(series(*ARTICLE), 5000.0), 0.11)
    fold, x = snaps(up)[0].before, snaps(up)[0].x
    assert fold.force(x + 1e-3) == fold.force(x) and fold.stiffness(x + 1e-3) == 0.0
    # a square root: T - T_fold ~ sqrt(x_fold - x), so the ratio of differences is 10 for a factor of 100
    near, far = (fold.force(x - d) - fold.force(x) for d in (1e-11, 1e-9))
    assert far / near == pytest.approx(10.0, rel=1e-2)


def test_bistable_beams_keep_their_state_while_slack():
    beam = Beam(5.0, 10.0, 0.01)
    branch = start(series(beam, beam), 2000.0)
    there, up = follow(branch, 0.06)
    back, down = follow(there, -0.01)
    assert snaps(up) and not back.taut and back.snapped == 2
    rest = back.displacements(-0.01)
    assert back.upper == pytest.approx(rest.sum(), rel=1e-15) and rest.min() > 0.01
    np.testing.assert_allclose([force_of(beam, u) for u in rest], 0.0, atol=1e-13)
    assert back.energy(-0.01) > 0.0
    again, events = follow(back, back.upper + 1e-4)
    assert again.taut and again.force(back.upper) == pytest.approx(0.0, abs=1e-10) and not snaps(events)
    assert snaps(up + down) and not snaps(follow(again, 0.06)[1])


beams = st.builds(Beam, st.floats(0.5, 50.0), st.floats(1.0, 11.0), st.floats(2e-3, 0.04))


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.lists(beams, min_size=1, max_size=4), st.floats(1.5, 6.0))
def test_every_branch_is_a_stable_minimum(parts, power):
    k = 10.0**power
    first = start(series(*parts), k)
    far = 2.1 * sum(part.h for part in parts) + 5.0 * max(part.Q for part in parts) / k
    there, up = follow(first, far)
    _, down = follow(there, -1.0)
    scale = max(part.Q for part in parts)
    for event in up + down:
        assert event.loss >= 0.0
        if event.loss == 0.0:
            jump = event.after.force(event.x) - event.before.force(event.x)
            assert abs(jump) <= 1e-9 * scale
    for branch in {e.after for e in up + down} - {there}:
        if branch.taut:
            check_minimum(branch, parts, k, scale)


def derivative(function, x, step):
    """Five-point difference: near a fold the curvature of a force spoils one of three points (7e-4 of it in 1 of 12 series)."""
    near, far = (function(x + d) - function(x - d) for d in (step, 2.0 * step))
    return (8.0 * near - far) / (12.0 * step)


def check_minimum(branch, parts, k, scale):
    for share in (0.01, 0.3, 0.6, 0.99):
        x = branch.lower + share * (min(branch.upper, branch.lower + 1.0) - branch.lower)
        u, tension = branch.displacements(x), branch.force(x)
        assert u.sum() + tension / k == pytest.approx(x, rel=1e-12)
        slopes = []
        for part, v, n, law in zip(parts, u, branch.at, branch.memory.parts):
            if n == len(law.monotone):
                assert v == 2.0 * part.h and tension >= 4.0 * part.Q * (1.0 - 1e-9)
            else:
                assert force_of(part, v) == pytest.approx(tension, rel=1e-6, abs=1e-9 * scale)
                slopes.append((force_of(part, v + 1e-7 * part.h) - force_of(part, v - 1e-7 * part.h)) / (2e-7 * part.h))
        if slopes:
            assert np.linalg.eigvalsh(np.diag(slopes) + k)[0] > -1e-6 * (k + max(np.abs(slopes)))
        step = 1e-3 * (min(branch.upper, branch.lower + 1.0) - branch.lower)
        if 0.1 < share < 0.9:
            slope = derivative(branch.force, x, step)
            assert branch.stiffness(x) == pytest.approx(slope, rel=1e-4, abs=1e-12 * scale / step)
            power = derivative(branch.energy, x, step)
            assert tension == pytest.approx(power, rel=1e-5, abs=1e-12 * scale * x / step)


def test_bad_series_are_named():
    with pytest.raises(InputError, match="part 2 does not rise in the end"):
        start(series(CELL, Table((0.0, 1.0, 2.0), (0.0, 1.0, 1.0))), 100.0)
    with pytest.raises(InputError, match="stiffness = 0.0"):
        start(series(CELL), 0.0)
    with pytest.raises(InputError, match="at least one part"):
        start(series(), 100.0)
    with pytest.raises(InputError, match="outermost"):
        start(series(series(CELL)), 100.0)
