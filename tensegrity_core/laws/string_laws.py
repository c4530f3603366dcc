"""The elastic tension of all strings at once, each on a given piece of its force curve.

Pieces are numbered as in `elements`: 0 is slack, 1 a taut spring; others go on, up to the piece beyond a stop.  On its piece
a string's law is smooth, also beyond the piece's ends, so that Newton's method needs to know of no kink.

Every piece is a row of panels, and on a panel force and stiffness are polynomials of t = -1..1.  Slack, linear, snap and
bottomed-out pieces, polynomials and tables are polynomials anyway.  All others, as rises, are cut into panels until the
Chebyshev interpolants of the exact force and of the exact stiffness err by round-off only; beyond its ends a rise goes on
with its second order Taylor polynomial.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import polynomial

from ..errors import InputError
from ..model import Model
from ..model.elements import Element, Spring
from .elements import law
from .panels import DEGREE, NoPanels, Panel, table
from .two_way import TwoWay

MOST_KNOWN = 1000  # combinations of pieces that are kept ready
TOUCH = 1e-11  # m: a string as near as this to the end of its piece is at its end


def string_laws(model: Model) -> StringLaws:
    """The laws of a model's strings; made once for all models with the same.

    Raises InputError for a string with memory, and for one whose law goes on for ever and is no polynomial there.
    """
    for i in model.memories:
        raise InputError(
            f"string {model.string_names[i]} has memory (law = 'hysteretic'), so its tension is no function of "
            "its elongation; let statics.settle follow it, which carries the state of such strings along"
        )
    stiffness = tuple(model.stiffness.tolist())
    try:
        pushing = model.two_way.tolist()
        plain = (TwoWay(k) if two_way else Spring(k) for k, two_way in zip(stiffness, pushing))
        return _made(tuple(model.elements.get(i, one) for i, one in enumerate(plain)), stiffness)
    except NoPanels as failure:
        raise InputError(
            f"string {model.string_names[failure.string]}: beyond an elongation of {failure.start:g} m its law "
            "goes on for ever and is no polynomial; let statics.settle follow it, or end one of its parts with a "
            "stop or a straight line"
        ) from None


class StringLaws:
    """Tension, stiffness and energy of strings.  Make one with `string_laws`.

    elements: what each string is made of, or the law of a spring that also pushes; stiffness: of all strings, N/m.

    lower, upper: (S, P) m, the elongations at which each piece of each string begins and ends; narrow: (S,) m,
    what a step of the elongation must be small beside, inf where nothing falls.
    """

    def __init__(self, elements: tuple[Element | TwoWay, ...], stiffness: tuple[float, ...]):
        made, pieces = [one if isinstance(one, TwoWay) else law(one, k) for one, k in zip(elements, stiffness)], []
        for i, one in enumerate(made):
            try:
                pieces.append([one.panels(piece) for piece in range(len(one.breakpoints) + 1)])
            except NoPanels as failure:
                failure.string = i
                raise
        most = max((len(p) for p in pieces), default=0)
        shape = (len(pieces), most)
        self._known: dict[bytes, OnPieces] = {}
        self._all = most * np.arange(len(pieces))  # where each string's row of pieces begins
        self.lower, self.upper = np.full(shape, -np.inf), np.full(shape, np.inf)
        first, count = np.zeros(shape, dtype=int), np.ones(shape, dtype=int)
        self._ends = np.full((len(pieces), max(most - 1, 0)), np.inf)
        rows: dict[tuple, int] = {}
        panels: list[Panel] = []
        for s, own in enumerate(pieces):
            breaks = self._ends[s, : len(own) - 1]
            breaks[:] = made[s].breakpoints
            self.lower[s, 1 : len(own)], self.upper[s, : len(own) - 1] = breaks, breaks
            for p, row in enumerate(own):
                key = (elements[s], p, stiffness[s])
                if key not in rows:
                    rows[key] = len(panels)
                    panels += row
                first[s, p], count[s, p] = rows[key], len(row)
        start = np.where(np.isfinite(self.lower), self.lower, 0.0)
        cut = np.isfinite(self.upper) & (count > 1)
        self._density = np.where(cut, count / np.where(cut, self.upper - start, 1.0), 0.0).ravel()  # panels per m
        self._start, self._first, self._most = start.ravel(), first.ravel(), count.ravel() - 1
        self._spans = np.array([[p.centre for p in panels], [p.half for p in panels], [p.reach for p in panels]])
        bends = [polynomial.polyder(p.stiffness) / p.half for p in panels]
        laws_of = [p.force for p in panels], [p.stiffness for p in panels], bends
        self._laws = np.stack([table(rows) for rows in laws_of], axis=1)
        self._energy = table([p.energy for p in panels], DEGREE + 2)
        self.narrow = np.array([one.narrow for one in made])

    def piece_of(self, elongation: np.ndarray) -> np.ndarray:
        """(S,) the piece that holds each elongation (S,), m; at a breakpoint the piece that ends there."""
        return np.add.reduce(elongation[:, None] > self._ends, axis=1)

    def on(self, piece: np.ndarray) -> OnPieces:
        """The laws of these pieces (S,), ready for many elongations."""
        key = piece.tobytes()
        if key not in self._known:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[key] = OnPieces(self, piece)
        return self._known[key]

    def energy(self, elongation: np.ndarray, piece: np.ndarray) -> np.ndarray:
        """(S,) J stored at elongations (S,), m, inside these pieces (S,)."""
        at = self._all + piece
        row = ((elongation - self._start[at]) * self._density[at]).astype(int)
        row = self._first[at] + np.minimum(np.maximum(row, 0), self._most[at])
        centre, half, reach = self._spans.take(row, axis=1)
        t = (elongation - centre) / half
        powers = np.ones((len(row), DEGREE + 2))
        powers[:, 1:] = np.minimum(np.maximum(t, -reach), reach)[:, None]
        np.multiply.accumulate(powers, axis=1, out=powers)
        return np.einsum("ij,ij->i", self._energy.take(row, axis=0), powers)


class OnPieces:
    """Tension, stiffness and its slope of all strings, each on a fixed piece.

    piece: (S,); lower, upper: (S,) m, its ends; curved: (C,) the strings whose law there is no straight line.
    """

    def __init__(self, laws: StringLaws, piece: np.ndarray):
        self.piece = piece
        at = laws._all + piece
        self.lower, self.upper = laws.lower.ravel()[at], laws.upper.ravel()[at]
        first, most = laws._first[at], laws._most[at]
        centre, _half, _reach = laws._spans[:, first]
        curved = (most > 0) | (np.abs(laws._laws[first, 1, 1:]).max(axis=1, initial=0.0) > 0.0)
        self.curved = np.flatnonzero(curved)
        self._stiffness = np.where(curved, 0.0, laws._laws[first, 1, 0])
        self._force = np.where(curved, 0.0, laws._laws[first, 0, 0] - self._stiffness * centre)
        at = at[self.curved]
        self._start, self._density = laws._start[at], laws._density[at]
        self._first, self._most = first[self.curved], most[self.curved]
        self._laws, self._spans = laws._laws, laws._spans
        self._powers, self._none = np.ones((len(at), DEGREE + 1, 1)), np.zeros(len(at), dtype=int)

    def left(self, elongation: np.ndarray) -> np.ndarray:
        """(S,) bool: strings past the ends of their pieces at elongations (S,), m."""
        return (elongation < self.lower - TOUCH) | (elongation > self.upper + TOUCH)

    def __call__(self, elongation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(S,) N, (S,) N/m at elongations (S,), m, and (C,) N/m2, the slope of the curved strings' stiffness."""
        force = self._force + self._stiffness * elongation
        if not len(self.curved):
            return force, self._stiffness, self._start
        x = elongation[self.curved]
        row = ((x - self._start) * self._density).astype(int)
        np.minimum(np.maximum(row, self._none, out=row), self._most, out=row)
        centre, half, reach = self._spans.take(row + self._first, axis=1)
        t = inside = (x - centre) / half
        beyond = np.count_nonzero(np.abs(t) > reach)
        if beyond:
            inside = np.minimum(np.maximum(t, -reach), reach)
        powers = self._powers
        powers[:, 1:, 0] = inside[:, None]
        np.multiply.accumulate(powers, axis=1, out=powers)
        tension, stiffness, bend = (self._laws.take(row + self._first, axis=0) @ powers)[:, :, 0].T
        if beyond:
            over = (t - inside) * half
            tension = tension + over * (stiffness + 0.5 * bend * over)
            stiffness = stiffness + bend * over
        force[self.curved] = tension
        full = self._stiffness.copy()
        full[self.curved] = stiffness
        return force, full, bend


_made = lru_cache(maxsize=32)(StringLaws)
