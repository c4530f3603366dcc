"""Files of other programs, damaged: each is a scene still, or refused in one line, and nothing else happens.

The cases are seeded: ``python -m tests.interchange.test_damaged_files COUNT`` runs COUNT of each kind.
"""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

import tensegrity_core as tc
from tensegrity_core.errors import TensegrityError
from tests.interchange.test_csv import MEMBERS, NODES, SCENE
from tests.interchange.test_mjcf import FOREIGN
from tests.interchange.test_ntrt import PRISM
from tests.support.words import words

FILES = {
    "it.xml": {"it.xml": FOREIGN},
    "it.yaml": {"it.yaml": PRISM},
    "nodes.csv": {"nodes.csv": NODES, "members.csv": MEMBERS, "scene.csv": SCENE},
}
PIECES = (
    "nan",
    "1e400",
    "-1",
    '""',
    "[]",
    "{}",
    "null",
    "&a",
    "*a",
    "<",
    ">",
    "/",
    "[[",
    "1e-320",
    "true",
    "x" * 300,
    "ü",
    "\x00",
)
PIECES += ("-0.0", '"', "#", "%", "1 2 3", "name", "mass", 'type="ball"', "hinge", "9" * 400)
NUMBERS = ("0", "-1", "1e9", "1e-9", "nan", "1e30", "7")


def damaged(text: str, chance: random.Random) -> str:
    """One to three times letters lost, put in or doubled, lines exchanged, a number replaced."""
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(len(text) or 1)
        end, lines = at + chance.randint(1, 12), text.split("\n")
        a, b = (chance.randrange(len(lines)) for _ in range(2))
        lines[a], lines[b] = lines[b], lines[a]
        number = chance.choice([*re.finditer(r"-?\d+\.?\d*", text)] or [re.match("", text)])
        text = chance.choice(
            (
                text[:at] + text[end:],
                text[:at] + chance.choice(PIECES) + text[end:],
                text[:at] + 2 * text[at:end] + text[end:],
                "\n".join(lines),
                text[: number.start()] + chance.choice(NUMBERS) + text[number.end() :],
            )
        )
    return text


def outcome(kind: str, seed: int, folder: Path) -> str:
    chance = random.Random(seed)
    hit = chance.choice([*FILES[kind]])
    for name, text in FILES[kind].items():
        (folder / name).write_text(damaged(text, chance) if name == hit else text, encoding="utf-8")
    try:
        found = tc.import_scene(folder / kind)
    except TensegrityError as failure:
        assert "\n" not in str(failure) and len(str(failure)) > 20
        return "refused"
    assert found.text()
    return "scene"


@pytest.mark.parametrize("kind", FILES)
def test_damaged_files(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = [outcome(kind, seed, tmp_path) for seed in range(60)]
    assert found.count("refused") > 20 and found.count("scene") > 2
    assert {path.name for path in tmp_path.iterdir()} == {*FILES[kind]}


if __name__ == "__main__":
    import collections
    import tempfile

    (cases,) = words(__doc__, int)
    with tempfile.TemporaryDirectory() as place:
        for name in FILES:
            print(name, dict(collections.Counter(outcome(name, seed, Path(place)) for seed in range(cases))))
