"""Resource locations as importers write them, for Windows too: the decoder of native_runtime/resources.c, called by itself."""

import shutil
import subprocess

import pytest

from tensegrity_core.native import build

PROGRAM = """
#include "resources.c"
int main(int argc, char **argv)
{
    char path[512];
    decode(argv[1], path, argv[2][0] == 'w');
    return argc == 3 ? puts(path) < 0 : 1;
}
"""

UNIX = {
    "file:///tmp/a%20b": "/tmp/a b",
    "file:/tmp/a": "/tmp/a",
    "FILE:///tmp/a": "/tmp/a",
    "file://localhost/tmp/gr%C3%B6%C3%9Fe%20%231": "/tmp/größe #1",
    "file://host/tmp/a": "/tmp/a",
    "file:///a%2": "/a%2",
    "/tmp/a%20b": "/tmp/a%20b",
}
WINDOWS = {
    "file:///C:/a%20b": "C:/a b",
    "file:///C%3A/a": "C:/a",
    "file:/c:/a": "c:/a",
    "file://C:/a": "C:/a",
    "File:///C:/a": "C:/a",
    "file://localhost/C:/a": "C:/a",
    "file://server/share/x": "//server/share/x",
    "C:\\\\a": "C:\\\\a",
}


@pytest.fixture(scope="module")
def decode(tmp_path_factory):
    compiler = build.system_compiler()
    if compiler is None or not shutil.which(compiler[0]):
        pytest.skip("needs a C compiler")
    folder = tmp_path_factory.mktemp("uris")
    (folder / "main.c").write_text(PROGRAM, encoding="utf-8")
    includes = [f"-I{path}" for path in (build.RUNTIME, build.HERE, build.fmi_headers())]
    command = [*compiler, "-std=c99", "-Wno-unused-function", *includes, str(folder / "main.c"), "-o", str(folder / "decode")]
    subprocess.run(command, check=True)

    def call(uri, system):
        done = subprocess.run([str(folder / "decode"), uri, system], capture_output=True, check=True)
        return done.stdout.decode().rstrip("\n")

    return call


@pytest.mark.parametrize("uri", UNIX)
def test_on_unix(uri, decode):
    assert decode(uri, "unix") == UNIX[uri]


@pytest.mark.parametrize("uri", WINDOWS)
def test_on_windows(uri, decode):
    assert decode(uri, "windows") == WINDOWS[uri]
