"""Marks of tests that need tools, or minutes."""

from __future__ import annotations

import importlib.util
import os

import pytest

from tensegrity_core.output.page import bundle

#: Compiles for other platforms.  CI has ziglang for the web page, and leaves these minutes out unless TENSEGRITY_CROSS is set.
CROSS = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None or ("CI" in os.environ and "TENSEGRITY_CROSS" not in os.environ),
    reason='compiles for other platforms: pip install ".[cross]", and in CI set TENSEGRITY_CROSS',
)
#: Builds what web pages have in common, or uses node.
PAGE = pytest.mark.skipif(bool(bundle.missing()), reason=f"needs: pip install {' '.join(bundle.missing())}")
