"""What runs as ``python -m``, of tests and benchmarks: asked for help it tells what it is for, and does nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def scripts() -> dict[str, str]:
    """Module -> text, of each that does something when it is run."""
    found = {}
    for path in (*(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if any(isinstance(node, ast.If) and "__main__" in ast.unparse(node.test) for node in ast.parse(text).body):
            found[".".join(path.relative_to(ROOT).with_suffix("").parts)] = text
    return found


#: What has a parser: our own, the one of the pages and studies of benchmarks/, or a word for help of its own.
PARSERS = ("words(__doc__", "ArgumentParser(", "STUDY", "PAGE", "command(__doc__", '"--help"')


def test_every_script_takes_its_words_from_a_parser():
    known = scripts()
    assert len(known) > 30 and not [name for name, text in known.items() if not any(way in text for way in PARSERS)]


@pytest.mark.parametrize(("word", "code", "told"), [("--help", 0, "[SECONDS]"), ("much", 2, "invalid float value: 'much'")])
def test_a_script_that_is_asked_for_help_runs_nothing(word, code, told):
    line = [sys.executable, "-m", "tests.output.page_runs", word]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == code and told in done.stdout + done.stderr and "same to the last bit" not in done.stdout
