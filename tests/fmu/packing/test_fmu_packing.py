"""What is in an FMU, that the same content gives the same bytes, and that a file appears whole or not at all."""

import ast
import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fmpy import read_model_description

from fmu_src.packing import libraries
from fmu_src.packing.closure import import_closure
from fmu_src.packing.libraries import ON_ARM, PackError, here
from fmu_src.packing.pack import CORE, pack_python_fmu, write_zip
from tensegrity_core.kernel import LIBRARY
from tensegrity_core.native.build import PYTHON_LIBRARY
from tests.support import scene

ROOT = Path(__file__).resolve().parents[3]


def content(fmu):
    with zipfile.ZipFile(fmu) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_same_scene_same_bytes(fmus, tmp_path):
    again = pack_python_fmu(scene("six_bar_nsh"), tmp_path / "again.fmu")
    assert again.read_bytes() == fmus["six_bar_nsh"].read_bytes()


def test_another_process_packs_the_same_bytes(fmus, tmp_path):
    program = (
        "import sys; from pathlib import Path; from fmu_src.packing.pack import pack_python_fmu\n"
        "from tensegrity_core.scene import load_scene; from tensegrity_core.statics import build_model\n"
        "pack_python_fmu(build_model(load_scene('two_bar_nsh')), Path(sys.argv[1]))\n"
    )
    path = tmp_path / "other.fmu"
    command = [sys.executable, "-c", program, str(path)]
    subprocess.run(command, check=True, cwd=ROOT, env={"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "PATH": ""})
    assert path.read_bytes() == fmus["two_bar_nsh"].read_bytes()


def test_guid_stands_for_the_content(fmus, tmp_path):
    def guid(path):
        return read_model_description(str(path)).guid

    base = scene("two_bar")
    heavier = replace(base, bar_mass=2.0 * base.bar_mass)
    renamed = replace(base, description="the same motion, told otherwise")
    changed = [pack_python_fmu(model, tmp_path / f"{i}.fmu") for i, model in enumerate((heavier, renamed))]
    changed.append(pack_python_fmu(base, tmp_path / "flat.fmu", naming="flat"))
    assert len({guid(fmus["two_bar"]), *map(guid, changed)}) == 4


def test_the_private_name_stands_for_the_core(fmus, tmp_path):
    library = tmp_path / LIBRARY
    library.write_bytes((CORE / "native" / LIBRARY).read_bytes() + b"\0")
    other = pack_python_fmu(scene("two_bar"), tmp_path / "other.fmu", library=library)
    names = [content(fmu)["resources/slavemodule.txt"] for fmu in (fmus["two_bar"], fmus["three_bar"], other)]
    assert names[0] == names[1] != names[2]


def test_files_of_an_fmu(fmus):
    files = content(fmus["three_bar_nsh"])
    ours = {here(), ON_ARM.get(here(), here())}
    binaries = {name for name in files if name.startswith("binaries/")}
    assert binaries == {f"binaries/{platform}/three_bar_nsh{Path(PYTHON_LIBRARY).suffix}" for platform in ours}
    assert files["model.png"].startswith(b"\x89PNG")
    assert b"MIT" in files["documentation/licenses/license.txt"] and files["documentation/licenses/pythonfmu.txt"]
    assert next(iter(files)) == "modelDescription.xml"
    with zipfile.ZipFile(fmus["three_bar_nsh"]) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.testzip() is None


def test_the_core_inside_needs_numpy_only(fmus):
    """Every import in the packed sources is of the standard library, of numpy, or relative, of the private package itself."""
    found = set()
    for name, source in content(fmus["three_bar_nsh"]).items():
        if name.endswith(".py"):
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.Import):
                    found |= {alias.name.split(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    found.add(node.module.split(".")[0])
    assert found - set(sys.stdlib_module_names) == {"numpy"}


def test_nothing_names_the_place_where_it_was_built(fmus):
    places = {os.fsencode(ROOT), os.fsencode(Path.home()) + b"/"}
    for name, data in content(fmus["six_bar"]).items():
        assert not [place for place in places if place in data], name


def test_documentation_escapes_what_a_scene_says(tmp_path):
    model = replace(scene("two_bar"), description='<script>alert("&")</script>')
    files = content(pack_python_fmu(model, tmp_path / "odd.fmu"))
    page = files["documentation/index.html"].decode()
    assert "<script>" not in page and "&lt;script&gt;" in page
    assert read_model_description(str(tmp_path / "odd.fmu")).description == model.description
    balanced = Balanced()
    balanced.feed(page)
    assert balanced.open == []
    for name in json.loads(files["resources/variables.json"])["names"]:
        assert f"<code>{name}</code>" in page


class Balanced(HTMLParser):
    """`open`: elements that were not closed in order."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attributes):
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, (tag, self.open)
        self.open.pop()


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "one.fmu"
    target.write_bytes(b"old")
    with pytest.raises(TypeError):
        write_zip(target, {"modelDescription.xml": b"new", "z": 3})
    assert target.read_bytes() == b"old" and list(tmp_path.iterdir()) == [target]


def test_platforms_without_a_name_are_told(monkeypatch, tmp_path):
    monkeypatch.setattr(libraries.platform, "machine", lambda: "riscv64")
    with pytest.raises(PackError, match="riscv64.*known: linux64"):
        pack_python_fmu(scene("two_bar"), tmp_path / "one.fmu")
    assert list(tmp_path.iterdir()) == []


def test_closure_follows_imports(tmp_path):
    package = tmp_path / "thing"
    package.mkdir()
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "a.py").write_text("from . import b\nimport numpy.linalg\n", encoding="utf-8")
    (package / "b.py").write_text("def f():\n    from thing.c import g\n    import scipy, os\n", encoding="utf-8")
    (package / "c.py").write_text("", encoding="utf-8")
    (package / "unused.py").write_text("", encoding="utf-8")
    files, foreign = import_closure(package, "a")
    assert [path.stem for path in files] == ["__init__", "a", "b", "c"] and foreign == {"numpy", "scipy"}
