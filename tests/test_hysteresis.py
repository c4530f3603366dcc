"""Series with memory: closed forms, the internal dynamics integrated by brute force, and what must hold for any series."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp

from tensegrity_core.elements import Beam, Parallel, Polynomial, Series, Spring, Table
from tensegrity_core.errors import InputError
from tensegrity_core.hysteresis import follow, start

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
    assert order == [0, 1, 2]    # ties: the lowest index


def test_article_honeycomb():
    up, down = cycle(start(series(*ARTICLE), 5000.0), 0.11)
    np.testing.assert_allclose([100.0 * e.x for e in snaps(up)], [3.51, 5.84, 8.39], atol=0.01)
    # at the last of a sweep's 25 um steps before the snap; at the fold itself the force has fallen further
    sweep = [e.before.force(math.floor(e.x / 25e-6) * 25e-6) for e in snaps(up)]
    np.testing.assert_allclose(sweep, [19.07, 24.20, 36.71], atol=0.005)
    assert [e.after.snapped for e in snaps(up)] == [2, 3, 4]
    assert len(snaps(down)) == 4
    assert sum(e.loss for e in up + down) == pytest.approx(0.457, abs=5e-4)
