"""The kernel's power function: as exact as its comment says, over all that a step size control can meet."""

import ctypes
import subprocess
import sys

import numpy as np
import pytest

from tensegrity_core.native import build
from tests.native.test_blocks import NATIVE, compiled

SHIM = """#include "linear/power.h"
#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
API double power(double base, double exponent) { return ts_real_power(base, exponent); }
"""


@pytest.fixture(scope="module")
def power(tmp_path_factory):
    function = compiled(tmp_path_factory.mktemp("power"), SHIM, ()).power
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double, ctypes.c_double]
    return function


def test_powers_are_those_of_the_platform_to_round_off(power):
    random = np.random.default_rng(3)
    for base, exponent in zip(10.0 ** random.uniform(-300.0, 300.0, 20_000), random.uniform(-1.0, 1.0, 20_000)):
        room = 1e-15 * (1.0 + abs(exponent * np.log2(base)))
        assert power(base, exponent) == pytest.approx(base**exponent, rel=room), (base, exponent)
    for base in (0.5**0.5, np.nextafter(0.5**0.5, 1.0), 1.0, np.nextafter(1.0, 0.0), 2.0, 5e-324, 1.7e308):
        for exponent in (-0.25, 1.0 / 3.0, 1.0, 0.0):
            assert power(base, exponent) == pytest.approx(base**exponent, rel=1e-15 * (1.0 + abs(exponent * np.log2(base))))


def test_powers_at_the_ends_of_their_range(power):
    assert power(0.0, 0.5) == 0.0
    assert power(0.0, -0.5) == np.inf
    assert power(0.0, 0.0) == power(3.0, 0.0) == 1.0
    assert np.isnan(power(np.nan, 0.5))
    assert power(1e300, 3.0) == np.inf
    assert power(1e-300, 3.0) == 0.0


def test_the_kernel_asks_no_c_library_for_what_libraries_round_differently():
    """Of the libraries' functions on real numbers only those stay that IEEE 754 or C fixes to the last bit."""
    if sys.platform == "win32" or build.system_compiler() is None:
        pytest.skip("needs nm and a system's C compiler")
    listed = subprocess.run(["nm", "-D", "--undefined-only", str(NATIVE / build.LIBRARY)], capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("nm is missing")
    asked = {line.split()[-1].split("@")[0] for line in listed.stdout.splitlines()}
    assert "memcpy" in asked
    loose = {
        "pow",
        "cbrt",
        "exp",
        "exp2",
        "expm1",
        "log",
        "log2",
        "log10",
        "log1p",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
    }
    loose |= {"atan2", "sinh", "cosh", "tanh", "hypot", "fma"}
    assert not asked & (loose | {f"{name}f" for name in loose})
