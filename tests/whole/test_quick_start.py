"""`python -m tests.support.quick_start` follows the pages with a wheel: here, which of their blocks it follows."""

from __future__ import annotations

import re

import pytest

from tests.support.quick_start import CLONE, blocks, pages
from tests.whole.test_readme import PAGES


def test_all_pages_are_followed():
    assert pages() == PAGES


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_blocks_can_be_followed_with_a_wheel(page):
    """All but the set-up of a clone and its benchmarks, of which a newcomer's pages have one at most."""
    followed, left_out = blocks(page)
    assert left_out <= 1
    for language, text in followed:
        assert language != "toml" or re.match(r"# \S+\.toml\n", text)
        assert "pytest" not in text and "build_fmu.py" not in text


def test_what_only_a_clone_has_is_known():
    for text in (
        "python -m benchmarks.redraw\n",
        "tensegrity new mast\npython build_fmu.py mast.toml\n",
        "python docs/draw_scenes.py\n",
    ):
        assert CLONE.search(text)
    assert not CLONE.search("tensegrity build two_bar --no-validate\n")
