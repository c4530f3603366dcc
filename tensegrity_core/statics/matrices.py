"""What statics solves with: freedoms of the nodes, bar and string lengths, dense and sparse matrices, null spaces."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy

from ..errors import TensegrityError
from ..model import Model

RANK_TOLERANCE = 1e-9  # singular values below this part of the largest count as zero
WHOLE = 2000  # degrees of freedom, or members, up to which singular values and eigenvalues are computed


class TooLarge(TensegrityError):
    """An analysis by dense matrices was asked for a structure beyond WHOLE."""


def freedoms(model: Model) -> int:
    return len(model.free_coordinates)


class Dense:
    """A dense matrix of a shape as the sum of values at fixed places: rows and columns broadcast; places outside of the shape,
    or negative ones, are left out."""

    def __init__(self, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]):
        (r, c), inside = shape, _inside(rows, columns, shape)
        self._shape, self._size = (r + 1, c + 1), (r + 1) * (c + 1)  # the last row and column take what is left out
        self._places = np.where(inside, rows * (c + 1) + columns, self._size - 1).ravel()

    def __call__(self, values: np.ndarray) -> np.ndarray:
        summed = np.bincount(self._places, values.reshape(-1), self._size)
        return summed.reshape(self._shape)[:-1, :-1]


class Sparse:
    """The same as a sparse matrix."""

    def __init__(self, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]):
        self._shape, kept = shape, _inside(rows, columns, shape)
        rows, columns = np.broadcast_arrays(rows, columns)
        self._rows, self._columns, self._kept = rows[kept], columns[kept], kept

    def __call__(self, values: np.ndarray) -> scipy.sparse.csc_array:
        return scipy.sparse.coo_array(
            (values.reshape(self._kept.shape)[self._kept], (self._rows, self._columns)), self._shape
        ).tocsc()


Matrix: TypeAlias = "np.ndarray | scipy.sparse.csc_array"


def _inside(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    return (rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1])


def require_small(model: Model, what: str) -> None:
    size = max(freedoms(model), len(model.strings) + len(model.bars))
    if size > WHOLE:
        most = f"structures of up to {WHOLE} degrees of freedom and members"
        raise TooLarge(f"{model.name}: {what} is for {most}; here are {size}")


def free_rows(model: Model, field: np.ndarray) -> np.ndarray:
    """A nodal field (N, 3) at the rows of the equilibrium matrix."""
    return field[:, model.axes].ravel()[model.free_coordinates]


def in_space(model: Model, free: np.ndarray) -> np.ndarray:
    """What free coordinates (n,) have as a nodal field (N, 3), zero elsewhere."""
    field = np.zeros((len(model.nodes), 3), dtype=free.dtype)
    flat = np.zeros(len(model.nodes) * len(model.axes), dtype=free.dtype)
    flat[model.free_coordinates] = free
    field[:, model.axes] = flat.reshape(-1, len(model.axes))
    return field


def lengths_between(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)


def shortest_bar(model: Model) -> float:
    """m; without bars the longest string's length at the start."""
    lengths = model.bar_length if len(model.bars) else -model.string_lengths(model.nodes)
    return float(np.abs(lengths.min(initial=np.inf)))


def lstsq(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(matrix, right, rcond=RANK_TOLERANCE)[0]


def null_space(matrix: np.ndarray, tolerance: float = RANK_TOLERANCE, largest: float = 1e-300) -> np.ndarray:
    """(c, k) orthonormal: what a matrix (r, c) makes nothing of, beside this part of its largest value or of `largest`."""
    _, values, right = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < matrix.shape[1])  # right is square
    return right[int(np.sum(values > tolerance * max(values.max(initial=0.0), largest))) :].T
