"""Kernel and reference on random structures: free and pinned bars, anchors, plain and NSH strings, both damping laws,
planar and not, under random forces and moving rest lengths."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_core import kernel, reference
from tensegrity_core.model import NSH, Inputs, Model, grid
from tests.support import by_hand


def random_model(seed: int) -> Model:
    random = np.random.default_rng(seed)
    bars = random.integers(1, 4)
    pinned = random.integers(0, 3, bars)  # 0 free, 1 first end fixed, 2 second end fixed
    planar = random.random() < 0.3
    nodes = random.uniform(-1.0, 1.0, (2 * bars + 1, 3)) * [1.0, 0.0 if planar else 1.0, 1.0]
    fixed = np.zeros(2 * bars + 1, bool)
    fixed[-1] = True  # an anchor
    fixed[2 * np.flatnonzero(pinned == 1)] = True
    fixed[2 * np.flatnonzero(pinned == 2) + 1] = True
    own = {(2 * i, 2 * i + 1) for i in range(bars)}
    pairs = [(i, j) for i in range(2 * bars + 1) for j in range(i) if not (fixed[i] and fixed[j]) and (j, i) not in own]
    strings = [pairs[i] for i in random.permutation(len(pairs))[: random.integers(1, min(7, len(pairs)) + 1)]]
    count = len(strings)
    length = np.linalg.norm(nodes[[j for _, j in strings]] - nodes[[i for i, _ in strings]], axis=1)

    def honeycomb():
        n = random.integers(1, 4)
        return NSH(tuple(random.uniform(3, 12, n)), tuple(random.uniform(2.2, 7.5, n)), tuple(random.uniform(0.01, 0.04, n)))

    return by_hand(
        nodes,
        np.flatnonzero(fixed),
        [(2 * i, 2 * i + 1) for i in range(bars)],
        strings,
        axes=(0, 2) if planar else (0, 1, 2),
        bar_mass=random.uniform(0.3, 3.0, bars),
        stiffness=random.uniform(300, 5000, count),
        damping=random.uniform(0, 60, count),
        rest_length=length * random.uniform(0.85, 1.02, count),
        nsh=tuple(honeycomb() if random.random() < 0.4 else None for _ in range(count)),
        damping_law=("literal", "tension_only")[random.integers(2)],
        gravity=9.81 if random.random() < 0.7 else 0.0,
    )


def random_inputs(model: Model, seed: int) -> Inputs:
    random = np.random.default_rng(seed + 10**6)
    times, shape = grid(0.24, 0.04), (6, len(model.strings))
    force = random.normal(scale=20.0, size=(6, len(model.nodes), 3)) * ~model.fixed[None, :, None]
    if len(model.axes) == 2:
        force[:, :, 1] = 0.0
    lengths = model.rest_length + random.uniform(-0.01, 0.01, shape)
    return Inputs(times, force, lengths, random.uniform(-0.2, 0.2, shape))


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10**6))
def test_kernel_and_reference_agree(seed):
    model = random_model(seed)
    inputs = random_inputs(model, seed)
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0, atol=1e-7)
    scale = 1e-3 + 1e-6 * np.abs(theirs.string_force).max()
    np.testing.assert_allclose(ours.string_force, theirs.string_force, rtol=0, atol=scale)
    np.testing.assert_allclose(ours.reaction, theirs.reaction, rtol=0, atol=20 * scale)
    np.testing.assert_allclose(ours.bar_force, theirs.bar_force, rtol=0, atol=20 * scale)
    assert ours.ledger_error() < 1e-8 and theirs.ledger_error() < 1e-8


@pytest.mark.parametrize("other", ["rodas5p", "radau9", "dopri5", "auto"])
@pytest.mark.parametrize("seed", range(12))
def test_methods_agree(seed, other):
    model = random_model(seed)
    inputs = random_inputs(model, seed)
    a = kernel.simulate(model, inputs, method="dop853", tolerance=1e-11)
    b = kernel.simulate(model, inputs, method=other, tolerance=1e-11)
    np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-7)
    assert [(t.string, t.before, t.after) for t in a.transitions] == [(t.string, t.before, t.after) for t in b.transitions]
