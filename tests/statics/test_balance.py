"""The one formulation of a structure at rest: its derivatives, and its two kinds of matrices."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model
from tensegrity_core.statics.balance import Balance
from tensegrity_core.statics.matrices import Dense, Sparse
from tensegrity_core.statics.settling import _flow_step


@pytest.fixture(scope="module", params=builtin_scenes())
def model(request):
    return build_model(load_scene(request.param))


def test_rows_and_stiffness_are_derivatives(model):
    balance, rng = Balance(model), np.random.default_rng(3)
    free = balance.start + 1e-2 * rng.standard_normal(balance.size)
    shape, count = balance.shape(free), len(model.strings)
    k, rest = 1000.0 + rng.random(count), 0.9 * shape.length
    bars = -rng.random(len(model.bars))

    def force(x):
        at = balance.shape(x)
        return balance.unbalanced(at, np.zeros(balance.size), np.concatenate([k * (at.length - rest) / at.length, bars]))

    density = np.concatenate([k * (shape.length - rest) / shape.length, bars])
    np.testing.assert_allclose(force(free), -density @ balance.rows(shape), rtol=0, atol=1e-11)
    step = 1e-6 * np.eye(balance.size)
    slopes = np.array([(force(free + h) - force(free - h)) / 2e-6 for h in step])
    np.testing.assert_allclose(balance.stiffness(shape, k, density), -slopes, rtol=0, atol=1e-5)
    squares = [(balance.shape(free + h).squared - balance.shape(free - h).squared) / 4e-6 for h in step]
    np.testing.assert_allclose(balance.rows(shape), np.transpose(squares), rtol=0, atol=1e-8)


def test_sparse_matrices_are_the_dense_ones(model):
    dense, sparse = Balance(model, Dense), Balance(model, Sparse)
    shape, members = dense.shape(dense.start), len(model.strings) + len(model.bars)
    density = np.linspace(-1.0, 1.0, members)
    k = np.linspace(1.0, 2.0, len(model.strings))
    np.testing.assert_allclose(sparse.stiffness(shape, k, density).toarray(), dense.stiffness(shape, k, density), atol=1e-14)
    np.testing.assert_array_equal(sparse.basis(shape).toarray(), dense.basis(shape))


def test_a_step_keeps_the_lengths_of_bars(model):
    balance = Balance(model)
    moved = balance.moved(balance.start, 1e-2 * np.random.default_rng(1).standard_normal(balance.size))
    lengths = balance.shape(moved).lengths[len(model.strings) :]
    np.testing.assert_allclose(lengths, balance.bar_length, rtol=4e-16)


def test_a_flow_that_no_step_follows_stays_where_it_is():
    tangent = SimpleNamespace(stiffest=1.0, way=lambda pull, time, negligible: None)
    point, surface = SimpleNamespace(tangent=tangent, pull=np.ones(2)), SimpleNamespace(balanced=1e-10)
    free, time = _flow_step(surface, np.zeros(2), point, np.inf)
    assert (free == 0.0).all() and time > 0.0
