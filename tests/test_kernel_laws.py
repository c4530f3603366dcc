"""The kernel's general force laws: curves against independent formulas, laws with memory against closed forms and sweeps, runs
against their energy ledger."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from tensegrity_core.elements import Beam, Parallel, Polynomial, Series, Spring, Table
from tensegrity_core.errors import InputError, TensegrityError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import NSH, Model

ARTICLE = NSH(Q=(6.0, 8.0, 10.0, 12.0), zeta=(3.0, 4.0, 5.0, 6.0), h=(0.01, 0.01, 0.015, 0.01))
MEMORY = dataclasses.replace(ARTICLE, law="hysteretic")
CELL = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4))
METHODS = ("auto", "dop853", "rodas5p", "radau9", "rk4", "ros2")


def mast(stiffness=5000.0, damping=20.0, law="literal", rest=1.4, **fields) -> Model:
    """A planar bar of 1 m and 1 kg pinned at the origin, guyed by two strings (left, right) to anchors 1 m beside it; the left one
    is a spring."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    both = {name: (None, fields.pop(name)) for name in ("nsh", "element", "damper") if name in fields}
    return Model(
        name="mast", description="a guyed mast", axes=(0, 2), node_names=("base", "tip", "west", "east"), bar_names=("bar",),
        string_names=("left", "right"), nodes=nodes, fixed=np.array([True, False, True, True]), bars=[[0, 1]], bar_mass=[1.0],
        strings=[[1, 2], [1, 3]], stiffness=[2000.0, stiffness], damping=[damping, damping], rest_length=[rest, rest],
        nsh=both.pop("nsh", (None, None)), damping_law=law, gravity=0.0, nominal=nodes, **both, **fields,
    )  # fmt: skip


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


# --- memory ----------------------------------------------------------------------------------------------------------


def test_trilinear_cells_follow_their_closed_form():
    kernel = Kernel(mast(200.0, element=Series((CELL,) * 3, "hysteretic")))
    there = np.linspace(0.0, 0.08, 4001)
    force, energy, loss, snaps = walk(kernel, np.concatenate([there, there[::-1]]))
    np.testing.assert_allclose(snaps, [0.035, 0.051, 0.067, 0.062, 0.046, 0.030], atol=1e-14)
    assert loss[loss > 0.0] == pytest.approx([1.142857142857143e-3] * 6, rel=1e-10)
    assert loss.sum() == pytest.approx(6.857142857142857e-3, rel=1e-10)
    assert force[4000] == pytest.approx((0.08 - 0.048) / 0.035, rel=1e-12)  # 3 (0.02 + (T - 0.4)/100) + T/200 = 0.08
    pieces = kernel.pieces(1)
    first = pieces[1]
    assert kernel.piece_law(1, 1, first.hi)[0] == pytest.approx(1.0, rel=1e-12)
    assert kernel.piece_law(1, first.up, first.hi)[0] == pytest.approx(0.5428571428571428, rel=1e-12)
    assert [p.snapped for p in pieces] == [0] * len(pieces)     # of beams; there are none


def test_the_articles_honeycomb_with_memory():
    kernel = Kernel(mast(5000.0, nsh=MEMORY))
    there = np.arange(0.0, 0.0951, 25e-6)
    force, energy, loss, snaps = walk(kernel, np.concatenate([there, there[::-1]]))
    up, down = snaps[snaps == np.maximum.accumulate(snaps)], snaps[3:]
    np.testing.assert_allclose(up, [0.0351, 0.0584, 0.0839], atol=1e-4)
    assert len(down) == 4 and (np.diff(down) < 0.0).all()
    last = np.flatnonzero(loss[: len(there)]) - 1      # of the sweep, before a snap
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
            2.0 * ARTICLE.h[j] if force >= 4.0 * ARTICLE.Q[j]
            else brentq(lambda v: beam_force(j, v) - force, third[j], 2.0 * ARTICLE.h[j], xtol=1e-17)
            for j in range(3)
        ]  # fmt: skip
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
