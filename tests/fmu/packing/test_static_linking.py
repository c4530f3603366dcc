"""Source FMUs of both versions of FMI in one program, in C and in C++: each keeps its names to itself, and does what its binary
does, to the last bit."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.native import build
from tests.support import scene
from tests.support.fmi3_calls import Calls3
from tests.support.native_calls import OK, Calls

STEPS, H, PUSH = 5, 0.01, 45.0
#: Prefix of an FMU's functions -> scene, version of the standard.
LINKED = {"one2_": ("two_bar", 2), "two2_": ("three_bar", 2), "one3_": ("two_bar", 3), "two3_": ("three_bar", 3)}
#: What compilers may say nothing about.
STRICT = ["-pedantic-errors", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
#: Compilers, and which FMUs they put into one program.
COMPILERS = {
    "gcc": (["-std=c99", *STRICT], tuple(LINKED)),
    "g++": (["-std=c++11", "-x", "c++", *STRICT], ("two2_", "two3_")),
}

HEAD = r"""
#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DECLARE2(p) \
    fmi2InstantiateTYPE p##fmi2Instantiate; \
    fmi2EnterInitializationModeTYPE p##fmi2EnterInitializationMode; \
    fmi2ExitInitializationModeTYPE p##fmi2ExitInitializationMode; \
    fmi2SetRealTYPE p##fmi2SetReal; \
    fmi2GetRealTYPE p##fmi2GetReal; \
    fmi2DoStepTYPE p##fmi2DoStep; \
    fmi2FreeInstanceTYPE p##fmi2FreeInstance;

#define DECLARE3(p) \
    fmi3InstantiateCoSimulationTYPE p##fmi3InstantiateCoSimulation; \
    fmi3EnterInitializationModeTYPE p##fmi3EnterInitializationMode; \
    fmi3ExitInitializationModeTYPE p##fmi3ExitInitializationMode; \
    fmi3SetFloat64TYPE p##fmi3SetFloat64; \
    fmi3GetFloat64TYPE p##fmi3GetFloat64; \
    fmi3DoStepTYPE p##fmi3DoStep; \
    fmi3FreeInstanceTYPE p##fmi3FreeInstance;
"""

MIDDLE = r"""
#ifdef __cplusplus
}
#endif

/* Prints the energy after each step under a force; size: of the vector that the force is the last element of. */
#define RUN2(p, guid, place, force, size, energy) \
    do { \
        double value, push = PUSH; \
        const fmi2ValueReference given = force + size - 1, looked = energy; \
        fmi2Component c = p##fmi2Instantiate("it", fmi2CoSimulation, guid, place, NULL, 0, 0); \
        if (!c || p##fmi2EnterInitializationMode(c) || p##fmi2ExitInitializationMode(c)) return 1; \
        if (p##fmi2SetReal(c, &given, 1, &push)) return 2; \
        for (int k = 0; k < STEPS; k++) { \
            if (p##fmi2DoStep(c, H * k, H, 1) || p##fmi2GetReal(c, &looked, 1, &value)) return 3; \
            printf("%.17g\n", value); \
        } \
        p##fmi2FreeInstance(c); \
    } while (0)

#define RUN3(p, token, place, force, size, energy) \
    do { \
        double value, push[3] = {0.0, 0.0, 0.0}, reached; \
        bool event, end, early; \
        const fmi3ValueReference given = force, looked = energy; \
        fmi3Instance c = p##fmi3InstantiateCoSimulation("it", token, place, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL); \
        push[size - 1] = PUSH; \
        if (!c || p##fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) || p##fmi3ExitInitializationMode(c)) return 4; \
        if (p##fmi3SetFloat64(c, &given, 1, push, size)) return 5; \
        for (int k = 0; k < STEPS; k++) { \
            if (p##fmi3DoStep(c, H * k, H, 1, &event, &end, &early, &reached)) return 6; \
            if (p##fmi3GetFloat64(c, &looked, 1, &value, 1)) return 7; \
            printf("%.17g\n", value); \
        } \
        p##fmi3FreeInstance(c); \
    } while (0)

int main(void)
{
"""


@pytest.fixture(scope="module")
def extracted(tmp_path_factory) -> dict[str, Path]:
    """Prefix -> folder of its FMU's files."""
    base, found = tmp_path_factory.mktemp("linked"), {}
    for prefix, (name, version) in LINKED.items():
        fmu = pack_native_fmu(scene(name), base / f"{prefix}.fmu", standard=f"{version}.0", sources=True)
        found[prefix] = base / prefix
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(found[prefix])
    return found


def loaded(folder: Path, name: str, version: int) -> tuple[np.ndarray, str]:
    """(STEPS,) energies by the binary of an FMU, and what the program must know of the FMU."""
    one = Calls(folder) if version == 2 else Calls3(folder)
    nodes = [v.removesuffix(".force.z").removesuffix(".force") for v in one.by_name if v.endswith((".force.z", "force"))]
    node = next(node for node in nodes if node.startswith("n"))
    axes = 2 if name.startswith("two_bar") else 3
    force = f"{node}.force" if version == 3 else f"{node}.force.x"
    given = {force: [0.0] * (axes - 1) + [PUSH]} if version == 3 else {f"{node}.force.z": PUSH}
    assert one.start() == OK and one.set(given) == OK
    energies = []
    for k in range(STEPS):
        assert one.step(H * k, H) == OK
        energies.append(float(np.ravel(one.get("energy.kinetic"))[0]))
    resources = folder / "resources"
    token = one.description.guid if version == 2 else one.description.instantiationToken
    place = resources.as_uri() if version == 2 else f"{resources}/"
    references = [one.by_name[each].valueReference for each in (force, "energy.kinetic")]
    one.free()
    return np.array(energies), f'"{token}", "{place}", {references[0]}, {axes}, {references[1]}'


@pytest.mark.parametrize("compiler", COMPILERS)
def test_source_fmus_of_both_versions_in_one_program(compiler, extracted, tmp_path):
    if not shutil.which(compiler):
        pytest.skip(f"needs {compiler}")
    options, prefixes = COMPILERS[compiler]
    command, objects = [compiler, *options, "-O0", f"-I{build.fmi_headers()}"], []
    for prefix in prefixes:
        folder = tmp_path / prefix
        folder.mkdir()
        files = sorted(map(str, (extracted[prefix] / "sources").glob("*.c")))
        given = f"-DFMI{LINKED[prefix][1]}_FUNCTION_PREFIX={prefix}"
        subprocess.run([*command, given, "-c", *files], check=True, cwd=folder)
        own = sorted(map(str, folder.glob("*.o")))
        objects += own
        if shutil.which("nm"):
            listed = subprocess.run(["nm", "--defined-only", "-g", *own], check=True, capture_output=True, text=True).stdout
            lines = [line.split() for line in listed.splitlines() if len(line.split()) == 3]
            names = [name for _, kind, name in lines if kind != "W"]  # weak: C++'s own inline functions
            mangled = re.compile(rf"(_Z\w*\d+)?{prefix}")
            assert len(names) > 200 and not [name for name in names if not mangled.match(name)]
    expected, runs = [], []
    for prefix in prefixes:
        name, version = LINKED[prefix]
        energies, known = loaded(extracted[prefix], name, version)
        expected.append(energies)
        runs.append(f"RUN{version}({prefix}, {known});")
    declared = [f"DECLARE{LINKED[prefix][1]}({prefix})" for prefix in prefixes]
    constants = f"#define STEPS {STEPS}\n#define H {H}\n#define PUSH {PUSH}\n"
    text = constants + HEAD + "\n".join(declared) + MIDDLE + "\n".join([*runs, "return 0;", "}\n"])
    (tmp_path / "all.c").write_text(text, encoding="utf-8")
    subprocess.run([*command, "-c", "all.c"], check=True, cwd=tmp_path)
    subprocess.run([compiler, "all.o", *objects, "-o", "all", "-lm"], check=True, cwd=tmp_path)
    printed = subprocess.run([tmp_path / "all"], check=True, capture_output=True, text=True).stdout.split()
    assert np.array_equal(np.array(list(map(float, printed))), np.concatenate(expected))
    assert np.all(np.concatenate(expected) > 0.0)
