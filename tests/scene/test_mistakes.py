"""What each mistake in a scene file is answered with: the cases stand in mistakes.toml."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model
from tests.laws.test_elements import WHOLE
from tests.scene import test_scene, test_scene_ground, test_scene_joints, test_scene_loads
from tests.scene.test_scene import write

GOOD = {"braced": test_scene.GOOD, "crane": test_scene_loads.GOOD, "woven": WHOLE, "jointed": test_scene_joints.GOOD}
GOOD |= {"stick": test_scene_ground.GOOD}
MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("scene, case", [(scene, case) for scene, cases in MISTAKES.items() for case in cases])
def test_bad_scene(scene, case, tmp_path, capsys):
    mistake = MISTAKES[scene][case]
    (key, value, problem, remedy), text = mistake["says"], GOOD[scene]
    for old, new in [mistake[step] for step in ("replace", "and") if step in mistake]:
        assert old in text
        text = text.replace(old, new, 1)
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        build_model(load_scene(path))
    error = caught.value
    assert error.file == str(path)
    assert error.key == key
    assert value in repr(error.value)
    assert problem in error.problem
    assert remedy in error.remedy
    for part in (str(path), error.key, error.problem, error.remedy):
        assert part in str(error)

    assert main(["check", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"{error}\n"
    assert [found.name for found in tmp_path.iterdir()] == ["scene.toml"]
