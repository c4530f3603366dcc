"""Wheels for other platforms: what they hold, and what is said where none can be built.

`python -m tests.support.wheels_checked` builds all of them, and runs them as far as a machine can.
"""

from __future__ import annotations

import pytest

from tensegrity_core.native import build, wheels
from tests.support.tools import CROSS
from tests.support.wheels_checked import check_contents


@CROSS
def test_a_wheel_for_another_platform_holds_its_libraries_and_no_others(tmp_path, capsys):
    ours = (build.HERE / build.LIBRARY).read_bytes()
    assert wheels.main(["--platforms", "aarch64-linux", "--output", str(tmp_path / "new" / "folder")]) == 0
    (wheel,) = (tmp_path / "new" / "folder").iterdir()
    assert capsys.readouterr().out == f"wrote {wheel}\n"
    check_contents(wheel, "aarch64-linux")
    assert (build.HERE / build.LIBRARY).read_bytes() == ours  # the tree's own stay


def test_a_wheel_that_cannot_be_built_says_why(tmp_path, capsys, monkeypatch):
    with pytest.raises(SystemExit):
        wheels.main(["--platforms", "amiga"])
    assert "invalid choice: 'amiga'" in capsys.readouterr().err
    monkeypatch.setitem(
        build.TARGETS, "amiga", build.Target(".so", "m68k-amiga", "amiga")
    )  # the builder's process knows no such
    assert wheels.main(["--platforms", "amiga", "--output", str(tmp_path)]) == 2
    assert "TENSEGRITY_WHEEL_FOR = 'amiga' is no platform; use one of linux64" in capsys.readouterr().err
    monkeypatch.setattr(wheels, "ROOT", tmp_path)
    assert wheels.main(["--output", str(tmp_path)]) == 2
    assert f"{tmp_path} is no source tree" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
