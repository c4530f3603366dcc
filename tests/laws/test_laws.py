"""Force laws of element trees: closed forms, SciPy's interpolants, quadrature and differences."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from tensegrity_core.errors import InputError
from tensegrity_core.laws import damping, law
from tensegrity_core.model import NSH
from tensegrity_core.model.elements import Beam, Parallel, Polynomial, Series, Spring, Table

ARTICLE = NSH(Q=(6.0, 8.0, 10.0, 12.0), zeta=(3.0, 4.0, 5.0, 6.0), h=(0.01, 0.01, 0.015, 0.01))
SMOOTH = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4), "cubic")
CELL = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4))
K = 5000.0


def test_springs_in_series_and_in_parallel():
    series, parallel = law(Series((Spring(300.0), Spring(600.0)))), law(Parallel((Spring(300.0), Spring(600.0))))
    for x in (1e-6, 0.02, 3.0, 1e4):
        assert series.force(x) == pytest.approx(200.0 * x, rel=1e-14)
        assert parallel.force(x) == pytest.approx(900.0 * x, rel=1e-14)
        assert series.stiffness(x) == pytest.approx(200.0, rel=1e-13)
        assert series.energy(x) == pytest.approx(100.0 * x * x, rel=1e-13)
        assert series.elongation(200.0 * x) == pytest.approx(x, rel=1e-14)
    assert series.breakpoints == parallel.breakpoints == (0.0,) and series.force(-1.0) == series.energy(-1.0) == 0.0


def test_polynomial():
    made = law(Polynomial((100.0, -6000.0, 120000.0)))  # f' = 100 - 12000 x + 360000 x^2 = 100 (1 - 60 x)^2
    x = np.linspace(0.0, 0.05, 11)
    np.testing.assert_allclose([made.force(v) for v in x], 100.0 * x - 6e3 * x**2 + 1.2e5 * x**3, rtol=1e-13, atol=1e-15)
    assert made.breakpoints == (0.0,)
    falling = law(Polynomial((200.0, -15000.0, 340000.0)))  # f' = 200 - 30000 x + 1020000 x^2
    roots = [(30000.0 + s * math.sqrt(9e8 - 8.16e8)) / 2.04e6 for s in (-1.0, 1.0)]
    np.testing.assert_allclose(falling.breakpoints, [0.0, roots[0]], rtol=1e-12)  # it goes on as it is where it rises again
    np.testing.assert_allclose([s.end for s in falling.monotone], [*roots, math.inf], rtol=1e-12)
    assert [falling.snapped_on_piece(p) for p in range(4)] == [0, 0, 1, 1]


@pytest.mark.parametrize("table", [CELL, SMOOTH])
def test_tables_are_their_interpolants(table):
    made = law(table)
    x = np.linspace(0.0, 0.03, 61)
    expected = np.interp(x, table.x, table.f) if table is CELL else PchipInterpolator(table.x, table.f)(x)
    np.testing.assert_allclose([made.force(v) for v in x], expected, rtol=1e-13, atol=1e-15)
    slope = made.stiffness(0.03)
    assert made.force(0.05) == pytest.approx(1.4 + 0.02 * slope, rel=1e-13)
    assert made.breakpoints == (table.x[:-1] if table is CELL else table.x)  # a linear table goes on as it is
    assert [made.snapped_on_piece(p) for p in range(5)] == [0, 0, 1, 1, 1]


def test_a_monotone_beam_has_one_piece_and_ends():
    made = law(Beam(5.0, 1.2, 0.01), K)
    assert made.breakpoints == (0.0, 0.02) and made.end_force == pytest.approx(20.0, rel=1e-15)
    assert made.force(0.021) == pytest.approx(25.0, rel=1e-12) and made.snapped_on_piece(2) == 0


def test_a_stop_in_parallel_ends_the_whole():
    made = law(Parallel((Beam(5.0, 4.0, 0.01), Spring(700.0))), K)
    assert made.end == 0.02 and made.end_force == pytest.approx(20.0 + 14.0, rel=1e-15)
    assert made.force(0.02 + 1e-3) == pytest.approx(39.0, rel=1e-13)
    assert law(Series((Beam(5.0, 4.0, 0.01), Spring(700.0)))).end == math.inf


def test_a_bistable_beam_is_fine_beside_a_spring():
    made = law(Series((Parallel((Beam(5.0, 12.0, 0.01), Spring(800.0))), Spring(400.0))))
    assert min(made.force(x) for x in np.linspace(1e-6, 0.1, 200)) > 0.0


TREES = [
    Series((Beam(6.0, 3.0, 0.01), Spring(2500.0), SMOOTH)),
    Series((CELL, CELL, Polynomial((400.0, 0.0, 9e4)))),
    Series((Series((Beam(6.0, 3.0, 0.01), Beam(8.0, 5.0, 0.02))), Parallel((Beam(5.0, 7.0, 0.01), Spring(50.0))))),
    Parallel((Series((Beam(6.0, 3.0, 0.01), Beam(8.0, 5.0, 0.02))), SMOOTH)),
    Series((Table((0.0, 0.01, 0.02, 0.05), (0.0, 2.0, 2.0, 5.0)), Spring(300.0), Beam(1.0, 4.0, 0.01))),
    Table((0.0, 0.01, 0.02), (0.0, 0.0, 3.0)),
]


@pytest.mark.parametrize("tree", TREES)
def test_trees_are_continuous_and_consistent(tree):
    made = law(tree, K)
    ends = [*made.breakpoints, made.breakpoints[-1] + 0.01]
    work = 0.0
    for p, (low, high) in enumerate(pairwise(ends), 1):
        assert high > low
        here = made.force(high)
        assert made.force_on_piece(p, high) == pytest.approx(here, rel=1e-12, abs=1e-13)
        beyond = p + 1 if high in made.breakpoints else p
        assert made.force_on_piece(beyond, high) == pytest.approx(here, rel=1e-9, abs=1e-12)
        work += quad(lambda x: made.force(x), low, high, epsabs=1e-13, epsrel=1e-12)[0]
        assert made.energy(high) == pytest.approx(work, rel=1e-9, abs=1e-15)
        x, step = 0.4 * low + 0.6 * high, 1e-5 * (high - low)
        slope = (made.force(x + step) - made.force(x - step)) / (2.0 * step)
        assert made.stiffness(x) == pytest.approx(slope, rel=1e-6, abs=1e-6 * here / high)
    for force in (0.1, 1.0, 3.0):
        assert made.force(made.elongation(force)) == pytest.approx(force, rel=1e-12)


def test_a_series_holds_the_others_while_one_snaps():
    made = law(Series((CELL, Spring(50.0))))
    # rises to 1 N: .01 + .02 m; the cell alone goes on to its next 1 N at .026 m
    np.testing.assert_allclose(made.breakpoints, [0.0, 0.03, 0.04, 0.046], rtol=1e-13)
    assert made.force(0.035) == pytest.approx(0.7, rel=1e-13) and made.force(0.04) == pytest.approx(0.4, rel=1e-13)
    assert made.stiffness(0.05) == pytest.approx(1.0 / (1.0 / 100.0 + 1.0 / 50.0), rel=1e-12)


@pytest.mark.parametrize(
    "bad, message",
    [
        (Spring(-1.0), r"spring.k = -1.0"),
        (Beam(5.0, math.nan, 0.01), "beam.zeta = nan"),
        (Beam(5.0, 9.0, 0.01), "the force falls to -.*hysteretic"),
        (Polynomial(()), "has 0 values"),
        (Polynomial((0.0, 0.0)), "are all 0"),
        (Polynomial((-1.0, 5.0)), "falls at first"),
        (Polynomial((1.0, -5.0)), "falls in the end"),
        (Polynomial((1.0, -10.0, 20.0)), "the force falls to -.* at an elongation of"),
        (Polynomial((1.0, math.inf)), r"coefficients\[2\] = inf"),
        (Table((0.0, 1.0), (0.0,)), "x has 2 points and f 1"),
        (Table((0.0, 1.0, 1.0), (0.0, 1.0, 2.0)), "let x increase"),
        (Table((0.0, 1.0), (1.0, 2.0)), r"f\[0\] = 1.0"),
        (Table((0.0, 1.0, 2.0), (0.0, 1.0, 0.5)), "falls beyond the last point"),
        (Table((0.0, 1.0), (0.0, 1.0), "spline"), "use 'linear' or 'cubic'"),
        (Series(()), "at least one part"),
        (Series((Series((CELL,), "hysteretic"),)), "outermost"),
        (
            Series((Table((0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 1.0, 1.0)), Spring(1.0))),
            "part 1 never bears its force maximum of 2.0 N",
        ),
    ],
)
def test_bad_elements_are_named(bad, message):
    with pytest.raises(InputError, match=message):
        law(bad)


def test_bad_requests():
    with pytest.raises(InputError, match="ends at 48"):
        law(ARTICLE.element).elongation(50.0)
    with pytest.raises(InputError, match="-1.0 N"):
        law(Spring(1.0)).elongation(-1.0)
    with pytest.raises(InputError, match="no more than 2.0 N"):
        law(Table((0.0, 1.0, 2.0), (0.0, 2.0, 2.0))).elongation(3.0)


def test_dampers_are_odd():
    for damper, expected in (
        (Polynomial((20.0, 0.0, 3.0)), lambda v: 20.0 * v + 3.0 * v**3),
        (Polynomial((0.0, 8.0)), lambda v: 8.0 * v * abs(v)),
        (
            Table((0.0, 0.1, 1.0), (0.0, 5.0, 6.0)),
            lambda v: math.copysign(np.interp(abs(v), (0.0, 0.1, 1.0), (0.0, 5.0, 6.0)), v),
        ),
    ):
        made = damping(damper)
        for v in (-0.9, -0.05, 0.0, 0.3, 1.0):
            assert made.force(v) == pytest.approx(expected(v), rel=1e-13)
    assert damping(Table((0.0, 0.1, 1.0), (0.0, 5.0, 6.0))).kinks == (0.1,) and damping(Polynomial((1.0,))).kinks == ()
    for bad in (Polynomial((-1.0,)), Polynomial((1.0, -2.0)), Table((0.0, 1.0, 2.0), (0.0, 1.0, -1.0))):
        with pytest.raises(InputError, match="drive the string"):
            damping(bad)
