"""The kernel's general force laws: curves against independent formulas, laws with memory against closed forms and sweeps, runs
against their energy ledger."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from tensegrity_core import laws as exact
from tensegrity_core.errors import InputError, TensegrityError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import NSH, Model
from tensegrity_core.model.elements import Beam, Parallel, Polynomial, Series, Spring, Table
from tests.support import by_hand

ARTICLE = NSH(Q=(6.0, 8.0, 10.0, 12.0), zeta=(3.0, 4.0, 5.0, 6.0), h=(0.01, 0.01, 0.015, 0.01))
MEMORY = dataclasses.replace(ARTICLE, law="hysteretic")
CELL = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4))
METHODS = ("auto", "dop853", "rodas5p", "radau9", "rk4", "ros2", "dopri5")


def mast(stiffness=5000.0, damping=20.0, law="literal", rest=1.4, **fields) -> Model:
    """A planar bar of 1 m and 1 kg pinned at the origin, guyed by two strings (left, right) to anchors 1 m beside it; the left
    one is a spring."""
    pair = {name: (None, fields.pop(name)) for name in ("nsh", "element", "damper") if name in fields}
    return by_hand(
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [0, 2, 3],
        [[0, 1]],
        [[1, 2], [1, 3]],
        axes=(0, 2),
        stiffness=[2000.0, stiffness],
        damping=damping,
        rest_length=rest,
        damping_law=law,
        **pair,
        **fields,
    )


def law(element, x, stiffness=5000.0):
    """Force (N), slope (N/m), energy (J) of an element at elongations x, (4, n) with the piece."""
    kernel = Kernel(mast(stiffness, element=element))
    return np.array([kernel.string_law(1, float(e)) for e in np.atleast_1d(x)]).T


def walk(kernel, elongations, string=1):
    """Quasi-static sweep over the graph: forces (N), energies (J), losses (J) on the way, and where snaps occurred (m)."""
    pieces, at, forces, energies, losses, snaps = kernel.pieces(string), 0, [], [], [], []
    for x in elongations:
        lost = 0.0
        while x > pieces[at].hi or x < pieces[at].lo:
            up = x > pieces[at].hi
            loss = pieces[at].loss_up if up else pieces[at].loss_down
            if loss > 0.0:
                snaps.append(pieces[at].hi if up else pieces[at].lo)
            lost += loss
            at = pieces[at].up if up else pieces[at].down
        force, _, energy = kernel.piece_law(string, at, x)
        forces.append(force), energies.append(energy), losses.append(lost)
    return np.array(forces), np.array(energies), np.array(losses), np.array(snaps)


def walk_from(pieces, at, target):
    """The first piece like `target` on the way up, else down, from piece `at`, and the losses (J) on that way; -1: none."""
    for up in (True, False):
        lost, here = 0.0, at
        while here >= 0 and pieces[here] is not target:
            lost += pieces[here].loss_up if up else pieces[here].loss_down
            here = pieces[here].up if up else pieces[here].down
        if here >= 0:
            return here, lost
    return -1, np.nan


# --- memory ----------------------------------------------------------------------------------------------------------


def test_trilinear_cells_follow_their_closed_form():
    kernel = Kernel(mast(200.0, element=Series((CELL,) * 3, "hysteretic")))
    there = np.linspace(0.0, 0.08, 4001)
    force, _energy, loss, snaps = walk(kernel, np.concatenate([there, there[::-1]]))
    np.testing.assert_allclose(snaps, [0.035, 0.051, 0.067, 0.062, 0.046, 0.030], atol=1e-14)
    assert loss[loss > 0.0] == pytest.approx([1.142857142857143e-3] * 6, rel=1e-10)
    assert loss.sum() == pytest.approx(6.857142857142857e-3, rel=1e-10)
    assert force[4000] == pytest.approx((0.08 - 0.048) / 0.035, rel=1e-12)  # 3 (0.02 + (T - 0.4)/100) + T/200 = 0.08
    pieces = kernel.pieces(1)
    first = pieces[1]
    assert kernel.piece_law(1, 1, first.hi)[0] == pytest.approx(1.0, rel=1e-12)
    assert kernel.piece_law(1, first.up, first.hi)[0] == pytest.approx(0.5428571428571428, rel=1e-12)
    assert {p.snapped for p in pieces} == {0, 1, 2, 3}


def test_the_articles_honeycomb_with_memory():
    kernel = Kernel(mast(5000.0, nsh=MEMORY))
    there = np.arange(0.0, 0.0951, 25e-6)
    force, energy, loss, snaps = walk(kernel, np.concatenate([there, there[::-1]]))
    up, down = snaps[snaps == np.maximum.accumulate(snaps)], snaps[3:]
    np.testing.assert_allclose(up, [0.0351, 0.0584, 0.0839], atol=1e-4)
    assert len(down) == 4 and (np.diff(down) < 0.0).all()
    last = np.flatnonzero(loss[: len(there)]) - 1  # of the sweep, before a snap
    np.testing.assert_allclose(force[last], [19.07, 24.20, 37.10], atol=0.5)  # it falls as a square root there
    np.testing.assert_allclose(force[last[:2]], [19.07, 24.20], atol=5e-3)
    assert loss.sum() == pytest.approx(0.457, abs=1e-3)
    assert energy[0] == energy[-1] == 0.0


def beam_force(j, u):
    """Eq. 11 for beam j of the article's honeycomb."""
    x = u / ARTICLE.h[j]
    return ARTICLE.Q[j] * (ARTICLE.zeta[j] * x**3 - 3.0 * ARTICLE.zeta[j] * x**2 + 2.0 * (1.0 + ARTICLE.zeta[j]) * x)


def test_a_fold_is_where_the_elongation_is_largest():
    """The last snap of a loading: beams 1 to 3 on III or at their stops, beam 4 falling."""
    third = [h * (1.0 + np.sqrt((z - 2.0) / (3.0 * z))) for z, h in zip(ARTICLE.zeta, ARTICLE.h)]

    def elongation(u):
        force = beam_force(3, u)
        others = [
            2.0 * ARTICLE.h[j]
            if force >= 4.0 * ARTICLE.Q[j]
            else brentq(lambda v, j=j: beam_force(j, v) - force, third[j], 2.0 * ARTICLE.h[j], xtol=1e-17)
            for j in range(3)
        ]
        return u + sum(others) + force / 5000.0, force

    u = np.linspace(0.00705, 0.00714, 2001)
    x, force = np.array([elongation(v) for v in u]).T
    kernel = Kernel(mast(5000.0, nsh=MEMORY))
    piece = next(i for i, p in enumerate(kernel.pieces(1)) if p.hi == pytest.approx(x.max(), abs=1e-9))
    assert kernel.piece_law(1, piece, kernel.pieces(1)[piece].hi)[0] == pytest.approx(force[x.argmax()], abs=1e-3)
    for v, at, f in zip(u[::100], x[::100], force[::100]):
        if v < u[x.argmax()] - 2e-6:
            assert kernel.piece_law(1, piece, at)[0] == pytest.approx(f, abs=1e-8)
    beyond = kernel.piece_law(1, piece, kernel.pieces(1)[piece].hi + 1e-4)
    assert beyond[:2] == (kernel.piece_law(1, piece, kernel.pieces(1)[piece].hi)[0], 0.0)


class Relaxation:
    """The parts of a string with memory, relaxed by their overdamped flow at every elongation: the definition, slow."""

    def __init__(self, nsh, stiffness):
        self.Q, self.zeta, self.h, self.k = np.array(nsh.Q), np.array(nsh.zeta), np.array(nsh.h), stiffness
        self.u = np.zeros(len(self.Q))

    def forces(self, u):
        x = u / self.h
        return self.Q * (self.zeta * x**3 - 3.0 * self.zeta * x**2 + 2.0 * (1.0 + self.zeta) * x)

    def slopes(self, u):
        x = u / self.h
        return self.Q / self.h * (3.0 * self.zeta * x**2 - 6.0 * self.zeta * x + 2.0 * (1.0 + self.zeta))

    def tension(self, x):
        """Relaxed at the elongation x (m), from where the last call left off: N."""
        u, size, step = self.u, 4.0 * self.Q.max(), 1e-3 / self.k
        for _ in range(4000):
            T = max(0.0, self.k * (x - u.sum()))
            rate = T - self.forces(u)
            free = ~(((u <= 0.0) & (rate < 0.0)) | ((u >= 2.0 * self.h) & (rate > 0.0)))
            if not free.any():
                break
            slopes = self.slopes(u)[free]
            hessian = np.diag(slopes) + (self.k if T > 0.0 else 0.0)
            if np.abs(rate[free]).max() < 1e-9 * size and np.linalg.eigvalsh(hessian)[0] > -1e-7:
                break
            h = min(step, 0.1 / max(-slopes.min(), 1e-9))
            move = np.linalg.solve(np.eye(len(slopes)) + h * hessian, h * rate[free])
            largest = np.abs(move).max() / self.h.min()
            step = 0.5 * h if largest > 1e-2 else 2.0 * h if largest < 5e-3 else h
            if largest < 2e-2:
                u = u.copy()
                u[free] += move
                u = np.clip(u, 0.0, 2.0 * self.h)
        else:
            raise AssertionError("the flow did not come to rest")
        self.u = u
        return max(0.0, self.k * (x - u.sum()))


@pytest.mark.parametrize(
    "nsh, stiffness",
    [
        (NSH((6.0, 9.0), (4.0, 5.0), (0.01, 0.02), "hysteretic"), 800.0),
        (NSH((6.0, 5.0), (9.0, 5.0), (0.01, 0.02), "hysteretic"), 20000.0),  # the first bistable: it stays snapped when slack
        (NSH((8.0, 3.0, 5.0), (1.5, 12.0, 7.0), (0.01, 0.01, 0.02), "hysteretic"), 1500.0),
    ],
)
def test_curves_with_memory_follow_the_flow(nsh, stiffness):
    kernel, flow = Kernel(mast(stiffness, nsh=nsh)), Relaxation(nsh, stiffness)
    total = 2.0 * sum(nsh.h) + 4.0 * max(nsh.Q) / stiffness
    turns = total * np.array([0.0, 1.02, -0.1, 0.6, 0.2, 0.8])
    sweep = np.concatenate([np.linspace(a, b, 120) for a, b in pairwise(turns)])
    force, _energy, _loss, snaps = walk(kernel, sweep)
    np.testing.assert_allclose(force, [flow.tension(x) for x in sweep], rtol=0, atol=1e-7 * force.max())
    assert len(snaps) >= 1


def nested_loops(n):
    """Cells whose loops of force lie inside each other: in a soft enough string each remembers for itself."""
    x = (0.0, 0.01, 0.0101, 0.04)
    return Series(tuple(Table(x, (0.0, 1.0 + 0.1 * i, 0.9 - 0.05 * i, 6.0)) for i in range(n)), "hysteretic")


def test_nested_loops_remember_each_for_itself():
    assert len(Kernel(mast(1.0, element=nested_loops(8))).pieces(1)) == 2**8 + 1
    with pytest.raises(TensegrityError, match="more than 4096 pieces"):
        Kernel(mast(1.0, element=nested_loops(13)))


def assert_consistent(kernel, size):
    """Force and energy at every joint; what snaps lose is what the energies say; energies are integrals of forces."""
    pieces = kernel.pieces(1)
    assert pieces[0].slack and pieces[0].lo == -np.inf and pieces[0].hi == 0.0
    for i, piece in enumerate(pieces):
        for end, beyond, loss in ((piece.lo, piece.down, piece.loss_down), (piece.hi, piece.up, piece.loss_up)):
            assert (beyond < 0) == (not np.isfinite(end))
            if beyond < 0:
                continue
            assert pieces[beyond].lo - 1e-12 <= end <= pieces[beyond].hi + 1e-12
            here, there = kernel.piece_law(1, i, end), kernel.piece_law(1, beyond, end)
            assert here[2] - there[2] == pytest.approx(loss, abs=1e-11 * size)
            assert loss > 0.0 or here[0] == pytest.approx(there[0], abs=1e-9 * size)
        low, high = max(piece.lo, 0.0), min(piece.hi, 0.2)
        if high > low:
            inside = np.linspace(low, high, 7)[1:-1]
            laws = np.array([kernel.piece_law(1, i, x) for x in inside])
            work = [quad(lambda x, i=i: kernel.piece_law(1, i, x)[0], a, b, epsabs=1e-15)[0] for a, b in pairwise(inside)]
            np.testing.assert_allclose(np.diff(laws[:, 2]), work, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("seed", range(6))
def test_graphs_with_memory_are_consistent(seed):
    random = np.random.default_rng(seed)
    n = random.integers(1, 5)
    Q, zeta, h = (tuple(random.uniform(low, high, n)) for low, high in ((1.0, 30.0), (0.5, 12.0), (0.003, 0.03)))
    nsh = NSH(Q, zeta, h, "hysteretic")
    assert_consistent(Kernel(mast(10.0 ** random.uniform(2.0, 4.5), nsh=nsh)), 4.0 * max(nsh.Q))


PLATEAU = Table((0.0, 0.019, 0.028, 0.046, 0.065), (0.0, 1.63, 1.14, 1.14, 3.15))
PEAKED = Table((0.0, 0.018, 0.033, 0.053, 0.085), (0.0, 2.57, 0.91, 0.91, 4.3), "cubic")


@pytest.mark.parametrize(
    "parts, stiffness",
    [
        ((Beam(2.4, 11.0, 0.024),) * 2, 34000.0),  # stiff: the second stays on its rise while the first falls, and back
        ((Beam(10.0, 5.0, 0.02),) * 3, 190.0),  # soft: one snap after the other
        ((PLATEAU, Beam(10.5, 1.07, 0.0056), PEAKED), 9200.0),  # one falls while another goes back along a level stretch
        ((Parallel((Beam(6.0, 5.0, 0.01), Spring(100.0))), Series((CELL, Spring(200.0)))), 5000.0),
        ((Parallel((PEAKED,)), Polynomial((200.0, 0.0, 1e6))), 45000.0),
    ],
)
def test_graphs_of_all_sorts_of_parts_are_consistent(parts, stiffness):
    assert_consistent(Kernel(mast(stiffness, element=Series(parts, "hysteretic"))), 40.0)


# --- general laws ----------------------------------------------------------------------------------------------------


def beam(Q, zeta, h):
    return lambda u: Q * (zeta * (u / h) ** 3 - 3.0 * zeta * (u / h) ** 2 + 2.0 * (1.0 + zeta) * u / h)


def test_single_elements():
    x = np.linspace(0.0, 0.05, 23)[1:]
    np.testing.assert_allclose(law(Spring(700.0), x)[0], 700.0 * x, rtol=1e-15)
    np.testing.assert_allclose(law(Spring(700.0), x)[2], 350.0 * x**2, rtol=1e-14)
    f, slope, energy, _ = law(Polynomial((50.0, 0.0, 3e4, -2e5)), x)
    np.testing.assert_allclose(f, 50.0 * x + 3e4 * x**3 - 2e5 * x**4, rtol=1e-13)
    np.testing.assert_allclose(slope, 50.0 + 9e4 * x**2 - 8e5 * x**3, rtol=1e-13)
    np.testing.assert_allclose(energy, 25.0 * x**2 + 7.5e3 * x**4 - 4e4 * x**5, rtol=1e-13)
    u = np.linspace(0.0, 0.02, 21)[1:-1]
    np.testing.assert_allclose(law(Beam(6.0, 5.0, 0.01), u)[0], beam(6.0, 5.0, 0.01)(u), rtol=1e-13)
    assert law(Beam(6.0, 5.0, 0.01), 0.023)[0] == pytest.approx(24.0 + 5000.0 * 0.003, rel=1e-13)  # past its stop


@pytest.mark.parametrize(
    "points",
    [
        ((0.0, 0.01, 0.03, 0.035, 0.06), (0.0, 2.0, 2.5, 2.5, 7.0)),
        ((0.0, 0.01, 0.02, 0.03), (0.0, 3.0, 1.0, 5.0)),
        ((0.0, 0.004, 0.02, 0.021, 0.05), (0.0, 0.001, 4.0, 9.0, 9.5)),
        ((0.0, 0.01), (0.0, 3.0)),
    ],
)
def test_tables(points):
    from scipy.interpolate import PchipInterpolator

    x, f = map(np.array, points)
    at = np.linspace(0.0, x[-1], 61)[1:]
    np.testing.assert_allclose(law(Table(*points), at)[0], np.interp(at, x, f), rtol=1e-13, atol=1e-15)
    slope = (f[-1] - f[-2]) / (x[-1] - x[-2])
    assert law(Table(*points), x[-1] + 0.1)[0] == pytest.approx(f[-1] + 0.1 * slope, rel=1e-13)
    cubic = PchipInterpolator(x, f)
    force, slopes, energy, _ = law(Table(*points, "cubic"), at)
    np.testing.assert_allclose(force, cubic(at), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(slopes, cubic(at, 1), rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(energy, [cubic.integrate(0.0, b) for b in at], rtol=1e-11, atol=1e-16)
    assert law(Table(*points, "cubic"), x[-1] + 0.1)[0] == pytest.approx(f[-1] + 0.1 * cubic(x[-1], 1), rel=1e-12)


def test_parallel_is_the_sum():
    parts = (Beam(6.0, 5.0, 0.01), Spring(100.0), Table((0.0, 0.004, 0.011), (0.0, 1.0, 1.2), "cubic"), Polynomial((0.0, 3e3)))
    x = np.linspace(0.0, 0.02, 37)[1:-1]
    laws = [law(part, x) for part in parts]
    together = law(Parallel(parts), x)
    for row in range(3):
        np.testing.assert_allclose(together[row], sum(one[row] for one in laws), rtol=1e-12)
    stop = law(Parallel(parts), 0.02)[0]
    assert law(Parallel(parts), 0.025)[0] == pytest.approx(stop + 5000.0 * 0.005, rel=1e-12)  # the beam's stop is that of all
    kernel = Kernel(mast(element=Parallel(parts)))
    assert [p.snapped for p in kernel.pieces(1)][-1] == 1


def test_series_of_straight_and_curved_parts():
    assert law(Series((Spring(300.0), Spring(600.0))), 0.4)[0] == pytest.approx(200.0 * 0.4, rel=1e-14)
    hardening, x = Polynomial((100.0, 0.0, 4e6)), np.concatenate([np.linspace(1e-4, 0.5, 30), [3.0, 40.0]])  # far past any use
    force = law(Series((hardening, Spring(500.0))), x)[0]
    exact = [brentq(lambda u, e=e: u + (100.0 * u + 4e6 * u**3) / 500.0 - e, 0.0, e, xtol=1e-18) for e in x]
    np.testing.assert_allclose(force, [100.0 * u + 4e6 * u**3 for u in exact], rtol=2e-11)
    table = Table((0.0, 0.01, 0.02), (0.0, 1.0, 4.0))
    expected = [1.0 * t for t in (0.5, 1.0, 2.5, 8.0)]
    x = [f / 200.0 + (f / 100.0 if f <= 1.0 else 0.01 + (f - 1.0) / 300.0) for f in expected]
    np.testing.assert_allclose(law(Series((Spring(200.0), table)), x)[0], expected, rtol=1e-13)


def test_series_of_beams_is_algorithm_1():
    parts = tuple(Beam(*row) for row in zip(ARTICLE.Q, ARTICLE.zeta, ARTICLE.h))
    kernel, honeycomb = Kernel(mast(element=Series(parts))), Kernel(mast(nsh=ARTICLE))
    x = np.linspace(0.0, 0.095, 997)[1:]
    ours, theirs = (np.array([k.string_law(1, e)[:3] for e in x]) for k in (kernel, honeycomb))
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], rtol=0, atol=3e-11)
    np.testing.assert_allclose(ours[:, 2], theirs[:, 2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(kernel.breakpoints(1), honeycomb.breakpoints(1), rtol=1e-11, atol=1e-14)
    snapped = [[k.pieces(1)[k.string_law(1, e)[3]].snapped for e in x] for k in (kernel, honeycomb)]
    assert snapped[0] == snapped[1]


def test_equal_parts_snap_one_after_the_other():
    cells = Kernel(mast(element=Series((CELL,) * 3)))
    x, F = [0.0], [0.0]
    for snapped in range(3):
        x += [0.03 + 0.016 * snapped, 0.04 + 0.016 * snapped, 0.046 + 0.016 * snapped]
        F += [1.0, 0.4, 1.0]
    x, F = [*x, x[-1] + 0.012], [*F, 1.4]
    at = np.linspace(0.0, x[-1], 301)[1:]
    np.testing.assert_allclose([cells.string_law(1, e)[0] for e in at], np.interp(at, x, F), rtol=0, atol=1e-12)


def test_nested_parts():
    """A beam with a spring beside it, in series with a spring and with a series of its own."""
    f = beam(6.0, 5.0, 0.01)
    stiffened = Parallel((Beam(6.0, 5.0, 0.01), Spring(2000.0)))  # monotone
    element = Series((stiffened, Series((Spring(300.0), Polynomial((200.0, 0.0, 1e6))))))

    def elongation(force):
        u = brentq(lambda v: f(v) + 2000.0 * v - force, 0.0, 0.02, xtol=1e-18)
        w = brentq(lambda v: 200.0 * v + 1e6 * v**3 - force, 0.0, 1.0, xtol=1e-18)
        return u + w + force / 300.0

    forces = np.linspace(0.5, 40.0, 25)
    np.testing.assert_allclose(law(element, [elongation(F) for F in forces])[0], forces, rtol=1e-10)
    twice = Parallel((element, Spring(10.0)))
    x = elongation(30.0)
    assert law(twice, x)[0] == pytest.approx(30.0 + 10.0 * x, rel=1e-10)


def test_a_fitted_part_snaps():
    """Its curve, cut where the force of the maximum is borne again, is the part's own."""
    inner = Series((Spring(150.0), Table((0.0, 0.01, 0.03), (0.0, 1.0, 4.0), "cubic")))
    part = Parallel((inner, Table((0.0, 0.011, 0.022, 0.06), (0.0, 2.8, 1.4, 6.0), "cubic")))
    x = np.linspace(0.0, 0.05, 301)[1:]
    alone = law(part, x)[0]
    peak = alone[:90].argmax()
    after = np.flatnonzero((alone >= alone[peak]) & (np.arange(300) > peak + 3))[0]
    assert 0 < peak < after - 10
    force = law(Series((part, Spring(700.0))), x[peak + 2 : after - 2] + alone[:90].max() / 700.0)[0]
    np.testing.assert_allclose(force, alone[peak + 2 : after - 2], rtol=0, atol=2e-3)  # the peak lies between samples


@pytest.mark.parametrize(
    "element, message",
    [
        (Parallel((Spring(1.0), Series((CELL, CELL), "hysteretic"))), "outermost"),
        (Series((Beam(6.0, 9.0, 0.01), Spring(100.0))), "must be hysteretic"),
        (Series((Polynomial((100.0, -1000.0)), Spring(100.0))), "bears again|hysteretic"),
        (Series((Table((0.0, 1.0), (0.0, -1.0)), Spring(1.0))), "does not rise"),
        (Series((Table((0.0, 1.0), (0.0, -1.0)), Spring(1.0)), "hysteretic"), "does not rise"),
        (Table((0.0, 0.02, 0.01), (0.0, 1.0, 2.0)), "does not increase"),
        (Spring(-5.0), "stiffness is not positive"),
        (Polynomial((1.0, np.inf)), "damaged"),
    ],
)
def test_laws_that_cannot_be(element, message):
    with pytest.raises(TensegrityError, match=message):
        Kernel(mast(300.0, element=element))


# --- runs ------------------------------------------------------------------------------------------------------------


def pulled(model, method, tolerance=1e-8, peak=30.0, last=0.0, steps=200, max_step=0.0):
    """A slow pull to the left and on to another one, `last` (N), over 2 s: the kernel at the end, its transitions, the largest
    ledger error."""
    fixed = 1e-4 if method in ("rk4", "ros2") else 0.0
    kernel = Kernel(model, method=method, tolerance=tolerance, max_step=max_step or fixed)
    kernel.initialize()
    transitions, worst, start = [], 0.0, None
    for i in range(steps):
        part = i / (0.5 * steps)
        kernel["force"][0] = -peak * part if part < 1.0 else -last + (last - peak) * (2.0 - part)
        kernel.step(2.0 / steps)
        transitions += kernel.transitions
        balance = sum(kernel[name][0] for name in ("kinetic", "potential", "elastic", "dissipated")) - kernel["input_work"][0]
        start = balance if start is None else start
        worst = max(worst, abs(balance - start) / max(1.0, kernel["throughput"][0]))
    return kernel, transitions, worst


def snaps_of(transitions):
    return [(t.before, t.after, round(t.loss, 9)) for t in transitions if t.loss > 0.0]


def test_all_methods_pass_the_same_snaps():
    model = mast(rest=2.0**0.5, nsh=MEMORY)
    _exact, expected, ledger = pulled(model, "radau9", 1e-12)
    assert len(snaps_of(expected)) == 7 and ledger < 1e-10
    at = np.array([t.time for t in expected if t.loss > 0.0])
    for method in METHODS:
        for tolerance in (1e-6, 1e-8, 1e-10) if method not in ("rk4", "ros2") else (1e-6,):
            kernel, transitions, ledger = pulled(model, method, tolerance)
            case = f"{method} at {tolerance}"
            assert snaps_of(transitions) == snaps_of(expected), case
            times = np.array([t.time for t in transitions if t.loss > 0.0])
            np.testing.assert_allclose(times, at, atol=max(200.0 * tolerance, 1e-8) + 1e-4 * (method == "ros2"), err_msg=case)
            if method not in ("rk4", "ros2"):
                assert ledger <= max(10.0 * tolerance, 1e-9), case
                assert kernel.stats["steps"] < 5000 and kernel.stats["rejected"] < 800, case
            else:
                assert ledger <= 1e-6, case


def test_fixed_steps_that_do_not_locate_every_transition():
    """ros2 locates four of them in a step and takes the rest from the elongations: with memory, along the graph."""
    model = mast(rest=2.0**0.5, nsh=MEMORY, damping=5.0)
    kernel, transitions, _ = pulled(model, "ros2", peak=1000.0, steps=20, max_step=0.1)
    found = [t for t in transitions if t.string == 1]
    for before, t in zip([0, *(t.after for t in found)], found):
        assert t.before == before
    assert any(abs(t.after - t.before) > 1 for t in found) and kernel["snapped"][0] == max(found[-1].after - 1, 0)
    pieces = kernel.pieces(1)
    called = [0 if p.slack else 1 + p.snapped for p in pieces]
    for t in found:  # what it loses is lost on a way along the graph between such pieces
        pairs = [
            (a, b) for a, one in enumerate(called) for b, other in enumerate(called) if (one, other) == (t.before, t.after)
        ]
        ways = [walk_from(pieces, a, pieces[b]) for a, b in pairs]
        assert any(passed == b and t.loss == pytest.approx(lost, abs=1e-12) for (_, b), (passed, lost) in zip(pairs, ways))


def test_slack_and_back_with_a_bistable_beam():
    """A bistable beam that has snapped stays so while its string is slack, which begins at a positive elongation then."""
    bistable = NSH((6.0, 5.0), (10.0, 5.0), (0.01, 0.02), "hysteretic")
    model = mast(rest=2.0**0.5, nsh=bistable)
    for method in ("dop853", "radau9"):
        kernel, transitions, ledger = pulled(model, method, 1e-9, peak=40.0, last=-20.0)
        pieces = kernel.pieces(1)
        slack = [i for i, p in enumerate(pieces) if p.slack]
        assert len(slack) == 2 and pieces[slack[1]].hi > 0.01 and pieces[slack[1]].snapped == 1
        assert {kernel.consequence(t) for t in transitions if t.after == 0} == {"slack"}
        ends = [(t.before, t.after) for t in transitions if 0 in (t.before, t.after) and t.string == 1]
        assert ends == [(0, 1), (2, 0)] and kernel["snapped"] == [1]  # slack with its first beam snapped
        assert ledger < 1e-8


def test_tension_only_with_memory():
    model = mast(rest=2.0**0.5, nsh=MEMORY, damping=100.0, law="tension_only")
    seen = []
    for method in ("dop853", "radau9", "auto"):
        kernel, transitions, ledger = pulled(model, method, 1e-9, peak=60.0, last=-20.0)
        seen.append(snaps_of(transitions))
        assert ledger < 1e-8 and len(seen[-1]) == 7 and seen[-1] == seen[0]
        assert (kernel["string_force"] >= 0.0).all()


def test_equal_strings_snap_together():
    """Two equal strings that are pulled alike, on one mast: both change their pieces in the same instants."""
    model = mast(nsh=MEMORY)
    nodes = np.vstack([model.nodes, [[1.0, 0.0, 0.0]]])
    model = dataclasses.replace(
        model,
        nodes=nodes,
        nominal=nodes,
        velocity=None,
        fixed=np.append(model.fixed, True),
        strings=[[1, 2], [1, 3], [1, 4]],
        node_names=(*model.node_names, "again"),
        string_names=(*model.string_names, "twin"),
        stiffness=[2000.0, 5000.0, 5000.0],
        damping=[20.0] * 3,
        rest_length=[2.0**0.5] * 3,
        nsh=(None, MEMORY, MEMORY),
        element=(),
        damper=(),
        actuator=(),
    )
    _, transitions, ledger = pulled(model, "auto", 1e-9, peak=60.0)
    one, two = ([(t.time, t.before, t.after, t.loss) for t in transitions if t.string == s] for s in (1, 2))
    assert one == two and len([t for t in one if t[3] > 0.0]) == 7 and ledger < 1e-8


def pushed(kernel, force, steps):
    """What the kernel holds after so many steps under a force, N, on the mast."""
    kernel["force"][0] = force
    for _ in range(steps):
        kernel.step(0.01)
    return kernel.values.tobytes(), kernel.state.tobytes(), kernel["snapped"].tobytes()


def test_a_saved_state_keeps_the_memory():
    model = mast(rest=2.0**0.5, nsh=MEMORY)
    for method in METHODS:
        kernel = Kernel(model, method=method, tolerance=1e-7, max_step=1e-3)
        kernel.initialize()
        pushed(kernel, -28.0, 100)
        pushed(kernel, -20.0, 40)  # on a branch that a first loading does not pass
        state = kernel.save()
        ends = []
        for again in range(3):
            kernel.restore(state)
            ends.append(pushed(kernel, -5.0, 60))
            if again == 1:
                kernel.initialize()
        assert ends[0] == ends[1] == ends[2], method
        other = Kernel(model, method=method, tolerance=1e-7, max_step=1e-3)
        other.restore(state)
        assert pushed(other, -5.0, 60) == ends[0], method


def test_a_step_that_fails_leaves_the_memory():
    kernel = Kernel(mast(rest=2.0**0.5, nsh=MEMORY), method="rk4", max_step=1e-3)
    kernel.initialize()
    kernel["force"][0] = -28.0
    for _ in range(100):
        kernel.step(0.01)
    state = kernel.save()
    kernel["stiffness"][1] = 6000.0
    with pytest.raises(InputError, match="stiffness.* was changed after initialization, which a string with memory"):
        kernel.step(0.01)
    kernel["stiffness"][1] = 5000.0
    kernel["stiffness"][0] = 2100.0  # of a plain string it may change
    kernel.step(0.01)
    kernel.restore(state)
    assert kernel.save() == state


def test_jumps_of_a_rest_length_walk_through_the_graph():
    """Shortened beyond three snaps and lengthened again, at once: the losses are dissipated and paid for by the input."""
    kernel = Kernel(mast(rest=2.0**0.5 + 0.2, nsh=MEMORY, damping=0.0), tolerance=1e-10)
    kernel.initialize()
    start = kernel.state
    kernel["rest_length"][1] = 2.0**0.5 - 0.09
    kernel.step(1e-7)
    up = kernel["dissipated"][0]
    walked = walk(kernel, [0.0, 0.09])[2].sum()
    assert up == pytest.approx(walked, rel=1e-6) and walked > 0.1 and kernel["snapped"][0] == 4
    kernel["rest_length"][1] = 2.0**0.5 + 0.2
    kernel.step(1e-7)
    assert kernel["dissipated"][0] == pytest.approx(walk(kernel, [0.0, 0.09, -0.2])[2].sum(), rel=1e-6)
    balance = sum(kernel[name][0] for name in ("kinetic", "potential", "elastic", "dissipated")) - kernel["input_work"][0]
    assert balance == pytest.approx(0.0, abs=1e-9) and kernel["snapped"][0] == 0
    assert kernel.state[:4] == pytest.approx(start[:4], abs=1e-5)


def test_a_start_is_that_of_a_first_loading():
    kernel = Kernel(mast(rest=2.0**0.5 - 0.07, nsh=MEMORY))
    kernel.initialize()
    force, _, _, piece = kernel.string_law(1, 0.07)
    assert kernel["elastic_force"][1] == pytest.approx(force, rel=1e-9) and kernel["dissipated"][0] == 0.0
    assert kernel["snapped"][0] == kernel.pieces(1)[piece].snapped == 3


def test_any_shape_is_a_beam_with_memory_only():
    kernel = Kernel(mast(nsh=NSH((6.0,), (9.0,), (0.01,), "hysteretic")))
    kernel["nsh_zeta"][0] = 1.0
    kernel.initialize()
    assert len(kernel.pieces(1)) == 3
    kernel["nsh_zeta"][0] = -1.0
    with pytest.raises(InputError, match="nsh_zeta.0. = -1.0 must be positive"):
        kernel.initialize()
    kernel = Kernel(mast(nsh=ARTICLE))
    kernel["nsh_zeta"][2] = 9.0
    with pytest.raises(InputError, match="nsh_zeta.2. = 9.0 must lie between 2 and 8"):
        kernel.initialize()


# --- dampers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "damper, force",
    [
        (Polynomial((30.0, 0.0, 400.0)), lambda r: 30.0 * r + 400.0 * r**3),
        (Polynomial((0.0, 80.0)), lambda r: 80.0 * r * abs(r)),
        (
            Table((0.0, 0.1, 0.3), (0.0, 9.0, 12.0)),
            lambda r: np.sign(r) * (min(abs(r), 0.1) * 90.0 + max(0.0, abs(r) - 0.1) * 15.0),
        ),
    ],
)
def test_dampers(damper, force):
    """Their force adds to that of d; the ledger closes; the Jacobian sees them."""
    model = mast(rest=1.35, damper=damper, damping=10.0)
    for velocity in (0.05, 0.4, -0.4):
        kernel = Kernel(dataclasses.replace(model, velocity=[[0, 0, 0], [velocity, 0, 0], [0, 0, 0], [0, 0, 0]]))
        kernel.initialize()
        rate = -velocity / 2.0**0.5
        drag = kernel["string_force"][1] - kernel["elastic_force"][1]
        assert drag == pytest.approx(10.0 * rate + force(rate), rel=1e-12)
    y = kernel.state
    Jq, Jv, _ = kernel.jacobian(y)
    n = len(Jq)
    for i in range(2 * n):
        step = np.zeros(len(y))
        step[i] = 1e-6
        column = (kernel.derivative(y + step) - kernel.derivative(y - step))[n : 2 * n] / 2e-6
        np.testing.assert_allclose(np.hstack([Jq, Jv])[:, i], column, rtol=0, atol=1e-6 * max(1.0, np.abs(Jq).max()))
    for law in ("literal", "tension_only"):
        for method in ("auto", "dop853", "rodas5p", "radau9"):
            _, _, ledger = pulled(dataclasses.replace(model, damping_law=law), method, 1e-9, peak=300.0)
            assert ledger < 1e-8, (law, method)


def test_a_linear_damper_is_d():
    plain, general = mast(rest=1.35, damping=40.0), mast(rest=1.35, damping=40.0, damper=Polynomial((25.0,)))
    plain = dataclasses.replace(plain, damping=[40.0, 65.0])
    ours, theirs = (pulled(model, "dop853", 1e-11, peak=300.0)[0] for model in (general, plain))
    np.testing.assert_allclose(ours.state[:4], theirs.state[:4], rtol=0, atol=1e-9)


# --- order -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fields",
    [
        {"nsh": MEMORY},
        {"element": Parallel((Table((0.0, 0.01, 0.03), (0.0, 10.0, 20.0), "cubic"), Polynomial((100.0, 0.0, 1e5))))},
        {"element": Series((Beam(6.0, 5.0, 0.01), Spring(800.0), Table((0.0, 0.01, 0.02), (0.0, 6.0, 18.0))))},
        {"damper": Polynomial((10.0, 0.0, 200.0)), "element": Series((Polynomial((400.0, 0.0, 4e6)), Spring(500.0)))},
    ],
)
def test_fixed_steps_keep_their_order(fields):
    model = mast(rest=2.0**0.5 - 0.003, **fields)
    exact = pulled(model, "radau9", 1e-13, steps=20)[0].state[:4]
    errors = [np.abs(pulled(model, "rk4", steps=20, max_step=h)[0].state[:4] - exact).max() for h in (4e-4, 2e-4, 1e-4)]
    order = np.log2(errors[0] / errors[2]) / 2.0
    if "nsh" in fields:  # at a fold the force ends as a square root: 5/2
        assert errors[2] < 1e-6 and order > 2.3, (errors, order)
    else:
        assert errors[2] < 1e-7 and (order > 3.0 or errors[2] < 1e-11), (errors, order)


@pytest.mark.parametrize("beams", [8, 9, 24])
def test_many_beams_in_series_are_the_exact_law(beams):
    """Beyond 8 beams the kernel has rows that get shorter towards the folds."""
    rng = np.random.default_rng(beams)
    nsh = NSH(rng.uniform(5.0, 15.0, beams), rng.uniform(2.1, 7.9, beams), rng.uniform(0.005, 0.02, beams))
    kernel = Kernel(mast(nsh=nsh))
    made = exact.law(nsh.element, 5000.0)
    end, most = made.end, made.end_force
    for x in np.linspace(0.0, 1.05 * end, 301):
        force, _, energy, _piece = kernel.string_law(1, x)
        assert abs(force - made.force(x)) < 2e-12 * most
        assert abs(energy - made.energy(x)) < 1e-12 * most * end
