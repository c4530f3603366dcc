"""Packed models that are wrong under a right checksum: each is refused or makes a kernel that works, in little time and memory.

The cases are seeded: `python -m tests.kernel.test_hostile_models COUNT` runs COUNT of them.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.kernel.unpacking import _HEADER
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, RATED, built
from tests.support.element_scenes import mast
from tests.support.rigged_scenes import RIGGED
from tests.support.touching import lying, moving, thrown
from tests.support.words import words

WHOLE = (-(2**31), -(10**6), -2, -1, 0, 1, 2, 3, 7, 100, 65536, 10**6, 10**6 + 1, 2**30, 2**31 - 1)
REAL = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1.0, 5e-324, 1e-300, 1e-12, 1e-3, 1e3, 1e12, 1e150, 1e300, 1.7e308, -1e300)
HEAD = 4 * _HEADER


def checked(body: bytes) -> bytes:
    """The model with a right checksum (FNV-1a, see native/model/packed.c)."""
    value = 14695981039346656037
    for byte in body:
        value = ((value ^ byte) * 1099511628211) & (2**64 - 1)
    return body + value.to_bytes(8, "little")


def packed() -> list[bytes]:
    models = [scene("two_bar"), scene("three_bar_nsh"), built(LABORATORY), built(RATED), built(RIGGED)]
    models += [moving(thrown()), lying(0.3, 0.3, planar=True)]
    models += [mast(name) for name in ("memory", "cells", "nested", "smooth", "valve", "hardening")]
    return [to_bytes(model) for model in models]


def mutated(good: bytes, random: np.random.Generator) -> bytes:
    """One to three numbers of a model replaced."""
    body = bytearray(good[:-8])
    for _ in range(random.integers(1, 4)):
        kind = random.integers(5)
        if kind == 0:
            body[random.integers(8, len(body))] ^= 1 << random.integers(8)
        elif kind == 1:
            at = 8 + 4 * random.integers(HEAD // 4)
            body[at : at + 4] = int(random.choice(WHOLE)).to_bytes(4, "little", signed=True)
        elif kind == 2:
            at = 8 + 4 * random.integers((len(body) - 8) // 4)
            body[at : at + 4] = int(random.choice(WHOLE)).to_bytes(4, "little", signed=True)
        else:
            at = len(body) - 8 * random.integers(1, (len(body) - HEAD) // 8)
            body[at : at + 8] = np.float64(random.choice(REAL)).tobytes()
    return checked(bytes(body))


def work(kernel: Kernel) -> None:
    kernel.initialize()
    for _ in range(3):
        kernel.step(1e-4)
        assert np.isfinite(kernel.values).all()
    kernel.output_derivatives()
    assert len(kernel.save()) == kernel.state_size


def run(first: int, count: int, library: str | None = None) -> None:
    """Seeds first .. first + count; says how each ended.  library: another kernel than the installed one."""
    bases = packed()
    for seed in range(first, first + count):
        print(seed, end=" ", flush=True)
        random, begin = np.random.default_rng(seed), time.process_time()
        try:
            work(Kernel(mutated(bases[seed % len(bases)], random), library))
        except TensegrityError as error:
            assert len(str(error)) > 10
            print("refused", end=" ")
        else:
            print("works", end=" ")
        print(f"{time.process_time() - begin:.2f}", flush=True)


#: A process of its own: what crashes there is a failure here.
CHILD = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
sys.path.insert(0, {here!r})
from tests.kernel import test_hostile_models
test_hostile_models.run({first}, {count})
"""


def report(first: int, count: int) -> list[list[str]]:
    pytest.importorskip("resource", reason="Windows has no way to bound the memory of a process")
    code = CHILD.format(here=str(Path(__file__).parents[2]), first=first, count=count)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=20 + 6 * count)
    rows = [line.split() for line in done.stdout.splitlines()]
    assert done.returncode == 0, (rows[-1:], done.stdout[-80:], done.stderr[-1500:])
    assert len(rows) == count and max(float(row[2]) for row in rows) < 10.0
    return rows


def test_wrong_models_under_a_right_checksum():
    rows = report(0, 150)
    ended = [row[1] for row in rows]
    assert min(ended.count("works"), ended.count("refused")) > 25


if __name__ == "__main__":
    (total,), size = words(__doc__, int), 500
    for start in range(0, total, size):
        found = report(start, min(size, total - start))
        slowest = max(found, key=lambda row: float(row[2]))
        print(f"{start}: {sum(row[1] == 'works' for row in found)} work, slowest {slowest[0]} with {slowest[2]} s", flush=True)
