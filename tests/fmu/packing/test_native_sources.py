"""The source FMU: it compiles without a warning, by fmpy's command too, and does the same to the last bit."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as XML

import fmpy
import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.model_description import read_build_description
from lxml import etree

from fmu_src import build as build_fmu
from fmu_src.packing.libraries import here
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.validation import outside
from fmu_src.validation.scenarios import pushed_node
from fmu_src.variables.interface import variables
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.model.components import flat
from tensegrity_core.native import build
from tests.support import changed, scene

SCENE = "three_bar_nsh"


@pytest.fixture(scope="module")
def fmu(tmp_path_factory) -> Path:
    return pack_native_fmu(scene(SCENE), tmp_path_factory.mktemp("sources") / f"{SCENE}.fmu", sources=True)


@pytest.fixture
def sources(fmu, tmp_path) -> Path:
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "fmu")
    return tmp_path / "fmu" / "sources"


def run(fmu: Path, folder: Path, naming: str = "structured") -> np.ndarray:
    """(101, outputs): a second of the square wave."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    description = read_model_description(str(fmu))
    instance = outside.Instance(description, str(folder))
    model = scene(SCENE)
    name = f"{model.node_names[pushed_node(model)]}.force.z"
    force = [flat(name) if naming == "flat" else name]
    times = np.arange(101) * 0.01
    values = np.where(times[:-1, None] < 0.5, 200.0, -200.0)
    out, _, _ = outside.run(instance, times, values, force, {})
    instance.close()
    return out


def test_descriptions_list_every_source_file(fmu, sources):
    files = sorted(path.name for path in sources.glob("*.c"))
    described = XML.parse(sources.parent / "modelDescription.xml").findall("CoSimulation/SourceFiles/File")
    assert [item.get("name") for item in described] == files
    (configuration,) = read_build_description(str(fmu))
    assert configuration.modelIdentifier == SCENE
    assert configuration.sourceFileSets[0].sourceFiles == files


def test_fmi_headers_stay_with_the_importer(sources):
    assert not list(sources.glob("fmi*.h"))
    texts = [path.read_text(encoding="utf-8") for path in sources.iterdir()]
    included = {name for text in texts for name in re.findall(r'#include "([^"]+)"', text)}
    assert included - {path.name for path in sources.iterdir()} == {"fmi2Functions.h"}


def test_sources_stay_out_unless_asked_for(tmp_path):
    with zipfile.ZipFile(pack_native_fmu(scene(SCENE), tmp_path / "one.fmu")) as archive:
        assert not [name for name in archive.namelist() if name.startswith("sources/")]
        assert b"SourceFiles" not in archive.read("modelDescription.xml")


def test_fmu_with_sources_is_small_and_valid(fmu):
    from fmpy.validation import validate_fmu

    assert fmu.stat().st_size <= 600_000
    assert validate_fmu(str(fmu)) == []


def compiler(name: str) -> list[str]:
    """Command of a compiler; skips the test where it is missing."""
    if name == "zig" and importlib.util.find_spec("ziglang"):
        return build.zig()
    if not shutil.which(name):
        pytest.skip(f"needs {name}")
    return [name]


@pytest.mark.parametrize("name", ["gcc", "clang", "zig"])
def test_sources_compile_without_a_warning(name, sources, tmp_path):
    command = compiler(name)
    options = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "-O1",
        "-s",
        "-fPIC",
        "-shared",
        f"-I{build.fmi_headers()}",
    ]
    files = sorted(map(str, sources.glob("*.c")))
    done = subprocess.run([*command, *options, *files, "-o", str(tmp_path / "one.so"), "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]


#: Ways to compile the sources without extensions of the language, with all warnings: gcc's and g++'s are errors.
STRICT = ["-pedantic-errors", "-Wall", "-Wextra", "-Wconversion", "-Wvla", "-Werror", "-O1", "-ffp-contract=off"]
PLAIN = {
    "gcc": ["-std=c99", "-DTS_PLAIN_C", *STRICT],
    "g++": ["-x", "c++", "-std=c++11", *STRICT],
    "tcc": ["-Wall", "-Werror"],
}


@pytest.fixture(scope="module", params=PLAIN)
def plain(request, fmu, tmp_path_factory) -> Path:
    """The native FMU's library in plain C or C++, with names of the kernel that others may call."""
    folder, command = tmp_path_factory.mktemp("plain"), compiler(request.param)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    files = sorted(map(str, (folder / "sources").glob("*.c")))
    line = [*command, *PLAIN[request.param], "-fPIC", "-shared", f"-I{build.fmi_headers()}", *files, "-lm"]
    done = subprocess.run([*line, "-o", str(folder / "plain.so")], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr[:3000]
    return folder / "plain.so"


def test_plain_c_and_cpp_do_the_same_to_the_last_bit(plain, fmu, tmp_path):
    other = tmp_path / "plain" / fmu.name
    other.parent.mkdir()
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(other, "w") as new:
        for item in old.namelist():
            new.writestr(item, plain.read_bytes() if item.startswith("binaries/") else old.read(item))
    np.testing.assert_array_equal(run(other, tmp_path / "one"), run(fmu, tmp_path / "two"))


def test_every_method_does_the_same_in_plain_c(plain):
    """In the plane and in space: real and complex systems, NSH, tension_only."""
    for model in (changed(scene("two_bar_nsh"), damping=2000.0), changed(scene("three_bar"), damping_law="tension_only")):
        for method in METHODS:
            kernels = [Kernel(model, path, method=method) for path in (None, plain)]
            for kernel in kernels:
                kernel.initialize()
                for n in range(30):
                    kernel["force"][-1] = 30.0 if n < 15 else -30.0
                    kernel.step(0.02)
            np.testing.assert_array_equal(kernels[0].values, kernels[1].values)
            assert kernels[0].stats == kernels[1].stats and kernels[0].stats["steps"] > 20


def test_fmpys_compile_command_makes_an_fmu_that_does_the_same_to_the_last_bit(fmu, tmp_path):
    if not shutil.which("cmake") or build.system_compiler() is None:
        pytest.skip("needs cmake and a C compiler")
    bare = tmp_path / "bare" / fmu.name
    bare.parent.mkdir()
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(bare, "w") as new:
        for name in old.namelist():
            if not name.startswith("binaries/"):
                new.writestr(name, old.read(name))
    done = subprocess.run([sys.executable, "-m", "fmpy", "compile", str(bare)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    with zipfile.ZipFile(bare) as archive:
        assert [name for name in archive.namelist() if name.startswith(f"binaries/{here()}/")]
    np.testing.assert_array_equal(run(bare, tmp_path / "one"), run(fmu, tmp_path / "two"))


def test_an_fmu_of_fmi_3_without_binaries_is_compiled_where_it_is_to_run(tmp_path):
    """And does what the one with binaries does."""
    if not shutil.which("cmake") or build.system_compiler() is None:
        pytest.skip("needs cmake and a C compiler")
    words = [SCENE, "--fmi", "3.0", "--no-page", "--no-validate", "--output", str(tmp_path)]
    assert build_fmu.main([*words, "--sources", "--no-binaries"]) == 0
    bare = tmp_path / "bare.fmu"
    (tmp_path / "native-fmi3" / f"{SCENE}.fmu").rename(bare)
    with zipfile.ZipFile(bare) as archive:
        names = set(archive.namelist())
    assert not any(name.startswith("binaries/") for name in names)
    assert "sources/fmi3.c" in names and not any(name.startswith("sources/fmi2") for name in names)
    done = subprocess.run([sys.executable, "-m", "fmpy", "compile", str(bare)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert build_fmu.main(words) == 0
    run = {"stop_time": 0.5, "output_interval": 0.01, "start_values": {"n4.force": [0.0, 0.0, 200.0]}}
    one, two = (simulate_fmu(str(fmu), **run) for fmu in (bare, tmp_path / "native-fmi3" / f"{SCENE}.fmu"))
    for name in one.dtype.names:
        np.testing.assert_array_equal(one[name], two[name])
    with zipfile.ZipFile(bare) as archive:
        assert b"FMI3_FUNCTION_PREFIX" in archive.read("sources/buildDescription.xml")


def test_simple_types_leave_reals_and_keep_every_reference(tmp_path):
    model = scene(SCENE)
    path = pack_native_fmu(model, tmp_path / f"{SCENE}.fmu", simple=True)
    described = read_model_description(str(path), validate=True, validate_variable_names=True, validate_model_structure=True)
    table = {row.name: row for row in variables(model)}
    left_out = set(table) - {v.name for v in described.modelVariables}
    assert left_out == {row.name for row in table.values() if row.field == "snapped"}
    assert {v.type for v in described.modelVariables if v.causality == "output"} == {"Real"}
    assert {v.type for v in described.modelVariables} == {"Real", "Integer"}
    assert all(v.valueReference == table[v.name].reference for v in described.modelVariables)
    assert not described.typeDefinitions
    assert np.all(np.isfinite(run(path, tmp_path / "fmu")))


@pytest.mark.parametrize("naming", ["structured", "flat"])
@pytest.mark.parametrize("name", ["two_bar", "three_bar_nsh"])
def test_terminals_join_variables_of_a_node_or_a_string(name, naming, tmp_path):
    model = scene(name)
    path = pack_native_fmu(model, tmp_path / "one.fmu", naming)
    known = {v.name: v for v in read_model_description(str(path)).modelVariables}
    with zipfile.ZipFile(path) as archive:
        document = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
    etree.XMLSchema(file=str(schema)).assertValid(document)
    found = {item.get("name"): {m.get("memberName"): m.get("variableName") for m in item} for item in document[0]}
    assert list(found) == [*model.node_names, *model.string_names]
    assert all(variable in known for members in found.values() for variable in members.values())
    free = model.node_names[model.free_nodes[0]]
    axes = ["xyz"[i] for i in model.axes]
    assert set(found[free]) == {*axes, *(f"force.{axis}" for axis in axes), *(f"velocity.{axis}" for axis in axes)}
    assert known[found[free][f"force.{axes[0]}"]].causality == "input"
    assert set(found[model.string_names[0]]) == {"rest_length", "rest_length_rate", "force", "length"}


CODE = """
import sys
from pathlib import Path
from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model
sources, standard = sys.argv[4] == "sources", sys.argv[5]
pack_native_fmu(build_model(load_scene(sys.argv[1])), Path(sys.argv[2]), sys.argv[3], sources=sources, standard=standard)
"""


@pytest.mark.parametrize("naming", ["structured", "flat"])
@pytest.mark.parametrize("packed, fmi", [("bare", "2.0"), ("sources", "2.0"), ("sources", "3.0")])
def test_another_process_packs_the_same_bytes(naming, packed, fmi, tmp_path):
    one = pack_native_fmu(scene(SCENE), tmp_path / "one.fmu", naming, sources=packed == "sources", standard=fmi)
    other = tmp_path / "elsewhere" / "one.fmu"
    root = Path(__file__).resolve().parents[3]
    surroundings = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    command = [sys.executable, "-c", CODE, SCENE, str(other), naming, packed, fmi]
    subprocess.run(command, check=True, cwd=root, env=surroundings)
    assert one.read_bytes() == other.read_bytes()


def test_flat_names_are_valid_and_give_the_same_trajectory(tmp_path):
    from fmpy.validation import validate_fmu

    namings = ("structured", "flat")
    fmus = {naming: pack_native_fmu(scene(SCENE), tmp_path / naming / f"{SCENE}.fmu", naming) for naming in namings}
    assert validate_fmu(str(fmus["flat"])) == []
    described = read_model_description(str(fmus["flat"]), validate_variable_names=True)
    assert described.variableNamingConvention == "flat"
    assert not [v.name for v in described.modelVariables if not re.fullmatch(r"\w+", v.name)]
    found = [run(path, tmp_path / f"{naming} fmu", naming) for naming, path in fmus.items()]
    np.testing.assert_array_equal(*found)
