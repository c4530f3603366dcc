"""The Python FMU in plain C hosts (python_host.c, native_host.c): ways to start and to end, hosts with a Python of their own,
folders of any name, the search for an interpreter.  Every process must end with exit code 0.

More of them, by other interpreters too: ``python -m tests.fmu.runtimes.test_python_host [INTERPRETER ...]``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import pytest

from fmu_src.packing.pack import pack_python_fmu
from tensegrity_core.kernel import Kernel
from tensegrity_core.native import build
from tests.conftest import once
from tests.fmu.runtimes import test_native_host
from tests.support import scene
from tests.support.native_calls import described, library_of
from tests.support.words import words

HERE = Path(__file__).parent
#: Of python_host.c.
STEPS, STEP, PUSH = 20, 1e-3, 45.0
ALONE = ("freed", "kept", "unloaded", "again", "resident", "last", "handed", "side", "race", "racing", "failed", "forked")
WITH_PYTHON = ("local", "global", "embedded", "held", "ended", "embedded_last")
#: Names of folders; the last one is no UTF-8.
NAMES = [
    *(c for c in "ü橋{}%#?';&+ \"<>|*~$`^=,@![]()"),
    "größe #1",
    "a b  c",
    " x ",
    "-x",
    "100%",
    "%41%C3%BC",
    "%n%s%zz",
    "\\",
    "file:",
    "日本語のフォルダ",
    "🏗",
    "é",
    "e\u0301",
    "\u00a0",
    "\u202e",
    "x" * 200,
    "a\nb",
    "{0}%s#?';&+ü橋",
    os.fsdecode(b"\xff\xfe"),
]

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the hosts are written for POSIX")


def shared_library() -> str | None:
    """libpython of the interpreter that runs this; None where it has none."""
    folder, name = sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("INSTSONAME")
    path = Path(folder or "") / (name or "")
    return str(path) if path.suffix != ".a" and path.is_file() else None


needs_library = pytest.mark.skipif(shared_library() is None, reason="this Python has no shared library")


def compiled(folder: Path) -> None:
    command = build.system_compiler()
    if command is None:
        pytest.skip("no C compiler: the C hosts are not run")
    folder.mkdir(parents=True, exist_ok=True)
    line = [*command, "-std=c99", "-Wall", "-Wextra", "-O1", f"-I{build.fmi_headers()}", str(HERE / "python_host.c")]
    done = subprocess.run([*line, "-ldl", "-lpthread", "-o", str(folder / "host")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def host(tmp_path_factory) -> Path:
    return once(tmp_path_factory, "python_host", compiled) / "host"


def places(folder: Path) -> tuple[int, int]:
    """Value references of the force that pushes and of the output that is read."""
    references = {v.name: v.valueReference for v in described(folder).modelVariables}
    top = "n4" if "n4.force.z" in references else "n3"
    return references[f"{top}.force.z"], references[f"{top}.z"]


@cache
def expected(name: str, pushed: int, read: int) -> float:
    kernel = Kernel(scene(name))
    kernel.initialize()
    kernel.values[pushed] = PUSH
    for _ in range(STEPS):
        kernel.step(STEP)
    return kernel.values[read].item()


def surroundings(**changes) -> dict[str, str]:
    """Environment in which the interpreter that runs this is found by the PATH."""
    kept = {name: value for name, value in os.environ.items() if name not in ("TENSEGRITY_PYTHON", "PYTHONHOME", "PYTHONPATH")}
    found = {**kept, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", **changes}
    return {name: value for name, value in found.items() if value is not None}


def call(host, folder, way, *more, location=None, before=(), original=None, **changes):
    """The finished process.  original: the folder that was copied, where fmpy cannot read the copy."""
    known = original or folder
    place = location or (folder / "resources").as_uri()
    text = [str(library_of(folder)), described(known).guid, place, *map(str, places(known))]
    line = [*before, str(host), *text, way, *map(str, more)]
    return subprocess.run(line, capture_output=True, text=True, errors="replace", timeout=300, env=surroundings(**changes))


def runs(host, folder, way, *more, scene_name="two_bar", **options):
    """The host ends well, and each of its runs gives what the kernel gives, to the last bit."""
    done = call(host, folder, way, *more, **options)
    assert done.returncode == 0, f"{way}: {done.returncode}\n{done.stdout}{done.stderr[-3000:]}"
    found = {float.fromhex(line) for line in done.stdout.split()}
    assert found == {expected(scene_name, *places(options.get("original") or folder))}, way
    return done


def fails(host, folder, *words, **options):
    """fmi2Instantiate gives a null pointer and says why; the process goes on."""
    done = call(host, folder, "freed", **options)
    assert done.returncode == 1 and "fmi2Instantiate: does not hold" in done.stderr, done.stderr
    assert all(word in done.stderr for word in words), done.stderr


# Ways to start and to end


def more_of(way, folder, tmp_path):
    """What comes behind the way."""
    return [shutil.copy(library_of(folder), tmp_path / "second.so")] if way == "racing" else []


@pytest.mark.parametrize("way", ALONE)
def test_hosts_without_python(way, host, python_folders, tmp_path):
    folder = python_folders["two_bar"]
    runs(host, folder, way, *more_of(way, folder, tmp_path))


@needs_library
@pytest.mark.parametrize("way", WITH_PYTHON)
def test_hosts_with_python(way, host, python_folders):
    runs(host, python_folders["two_bar"], way, shared_library(), PYTHONPATH=os.pathsep.join(sys.path))


@pytest.mark.parametrize("locale", ["C", "C.UTF-8"])
def test_folders_of_any_name(locale, host, python_folders, tmp_path):
    """All names as a chain of folders would be too long: a few at a time."""
    for k in range(0, len(NAMES), 12):
        copy = tmp_path.joinpath(str(k), *NAMES[k : k + 12])
        try:
            shutil.copytree(python_folders["two_bar"], copy)
        except OSError:
            pytest.skip("this file system does not take such names")
        runs(host, copy, "freed", original=python_folders["two_bar"], LC_ALL=locale)


@pytest.mark.parametrize("form", ["file:{}", "file://localhost{}", "file://{}/"])
def test_forms_of_the_location(form, host, python_folders, tmp_path):
    copy = shutil.copytree(python_folders["two_bar"], tmp_path / "ü #1% {x}")
    uri = (copy / "resources").as_uri().removeprefix("file://")
    runs(host, copy, "freed", location=form.format(uri))
    runs(host, copy, "freed", location=str(copy / "resources"))


@pytest.mark.parametrize("command", [("rollback",), ("threads", 8), ("cycles", 20), ("everything",), ("walk", 3, 3000)])
def test_the_native_fmus_host_runs_the_python_fmu(command, python_folders, tmp_path_factory):
    program = native_host(tmp_path_factory)
    test_native_host.run(program, python_folders["two_bar_nsh"], *command, environment=surroundings())


def native_host(tmp_path_factory) -> Path:
    def make(folder):
        test_native_host.compiled(folder, "host", [*test_native_host.WARNINGS, "-O2"])

    return once(tmp_path_factory, "native_host", make) / "host"


@pytest.mark.parametrize("seed", range(3))
def test_both_runtimes_answer_alike(seed, python_folders, native_folders, tmp_path_factory):
    """Thousands of random calls, many of them hostile: the same statuses in the same order."""
    program = native_host(tmp_path_factory)
    found = {
        test_native_host.run(program, folders["two_bar_nsh"], "walk", seed, 4000, environment=surroundings())
        for folders in (python_folders, native_folders)
    }
    assert len(found) == 1


# The search for an interpreter


def test_an_interpreter_by_name(host, python_folders):
    runs(host, python_folders["two_bar"], "freed", TENSEGRITY_PYTHON=sys.executable, PATH="/nowhere")


def fake(folder: Path, answer: str, name: str = "python3") -> str:
    """A program that answers like an interpreter."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(f"#!/bin/sh\nprintf '{answer}'\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("", "does not answer as Python does"),
        ("hello", "does not answer as Python does"),
        (r"version 2.7\\0program /usr/bin/python\\0", "is Python 2.7, but 3.11 or newer is needed"),
        (r"version 3.10\\0program x\\0", "is Python 3.10, but 3.11 or newer is needed"),
        (r"version 3.11\\0program x\\0numpy no\\0", "has no NumPy"),
        (r"version 3.11\\0program x\\0", "has no NumPy"),
        (r"version 3.11\\0program x\\0numpy yes\\0", "no shared library that can be loaded (none)"),
        (r"version 3.11\\0program x\\0numpy yes\\0library /nowhere/l.so\\0", "/nowhere/l.so: cannot open"),
    ],
)
def test_what_a_candidate_lacks_is_said(answer, words, host, python_folders, tmp_path):
    program = fake(tmp_path / "bin", answer.replace("\\\\0", "\\000"))
    fails(host, python_folders["two_bar"], f"TENSEGRITY_PYTHON={program}", words, TENSEGRITY_PYTHON=program)
    # one that will not do does not hide the next
    path = f"{tmp_path / 'bin'}{os.pathsep}{Path(sys.executable).parent}"
    runs(host, python_folders["two_bar"], "freed", PATH=path)


def test_a_candidate_of_several_names_is_reported_once(host, python_folders, tmp_path):
    """An environment without NumPy has `python`, `python3` and `python3.x`; links lead to it and to something that is no
    Python."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "bare")], check=True)
    other = fake(tmp_path / "other", "hello")
    (tmp_path / "links").mkdir()
    for name, target in {"python3": other, "python": other, "python3.11": "python3"}.items():
        (tmp_path / "links" / name).symlink_to(target)
    (tmp_path / "again").symlink_to(tmp_path / "bare")
    path = os.pathsep.join(str(tmp_path / name) for name in ("other", "bare/bin", "links", "again/bin"))
    done = call(host, python_folders["two_bar"], "freed", PATH=path)
    message = done.stderr[: done.stderr.rindex("fmi2Instantiate: does not hold")] if done.returncode else ""
    if done.returncode == 0:  # one of the usual folders, which are searched as well, has a Python that will do
        pytest.skip("there is a Python with NumPy in /usr/bin or beside it")
    assert message.count("does not answer as Python does") == 1 and other in message
    lacks = [part for part in message.split("; ") if "has no NumPy" in part and str(tmp_path) in part]
    assert len(lacks) == 1 and str(tmp_path / "bare" / "bin" / "python3") in lacks[0]


def test_no_interpreter_at_all(host, python_folders, tmp_path):
    fails(host, python_folders["two_bar"], "there is no such program", "TENSEGRITY_PYTHON", TENSEGRITY_PYTHON="/no/python3")
    fails(host, python_folders["two_bar"], "there is no such program", TENSEGRITY_PYTHON=str(tmp_path))


def test_a_candidate_that_floods_its_output(host, python_folders, tmp_path):
    program = fake(tmp_path, "")
    Path(program).write_text("#!/bin/sh\nhead -c 3000000 /dev/zero\n", encoding="utf-8")
    fails(host, python_folders["two_bar"], "does not answer as Python does", TENSEGRITY_PYTHON=program)


def test_a_python_path_that_shadows_modules(host, python_folders, tmp_path):
    """The folder in which the host runs is not searched for modules."""
    (tmp_path / "sysconfig.py").write_text("raise SystemExit(3)", encoding="utf-8")
    folder = python_folders["two_bar"]
    assert runs(host, folder, "freed", before=("env", "-C", str(tmp_path)))


# Faults


def altered(python_folders, tmp_path, old: str, new: str) -> Path:
    """A copy of an FMU whose slave has been changed, as docs/fmu.md says."""
    copy = shutil.copytree(python_folders["two_bar"], tmp_path / "altered")
    (copy / "resources" / "checksums.txt").unlink()
    (slave,) = copy.glob("resources/*/python_runtime/slave.py")
    text = slave.read_text(encoding="utf-8")
    assert text.count(old) == 1
    slave.write_text(text.replace(old, new), encoding="utf-8")
    return copy


HOOKS = {
    "setup_experiment": '        what, state = "fmi2SetupExperiment", self._state\n',
    "exit_initialization_mode": '        what = "fmi2ExitInitializationMode"\n',
    "do_step": '        state, what = self._state, "fmi2DoStep"\n',
    "get_real": '        what = "fmi2GetReal"\n',
    "set_real": '        self._set("fmi2SetReal", self._table.reals, self._values, references, values)\n',
    "__init__": "        super().__init__(**kwargs)\n",
}
RAISED = {
    "ZeroDivisionError": "1 / 0",
    "KeyError": "{}['100 %s %n #ü']",
    "SystemExit": "raise SystemExit(7)",
    "KeyboardInterrupt": "raise KeyboardInterrupt",
    "RecursionError": "f = lambda: f()\n        f()",
    "UnicodeEncodeError": "'\\udcff'.encode()",
    "ValueError": "raise ValueError('\\udcff \\0 x' * 1000)",
}


@pytest.mark.parametrize("raised", RAISED)
@pytest.mark.parametrize("hook", HOOKS)
def test_an_exception_is_a_message_and_an_error(hook, raised, host, python_folders, tmp_path):
    line = HOOKS[hook]
    folder = altered(python_folders, tmp_path, line, f"        {RAISED[raised]}\n{line}")
    done = call(host, folder, "freed")
    function = {"__init__": "fmi2Instantiate"}.get(hook, "fmi2" + "".join(word.capitalize() for word in hook.split("_")))
    assert done.returncode == 1 and f"{function}: does not hold" in done.stderr, done.stderr
    assert raised in done.stderr
    assert hook == "__init__" or "fault in" in done.stderr


@pytest.mark.parametrize(
    "returned", ["None", "[1.0, 2.0]", "'text'", "[]", "[None]", "np.zeros(7)", "np.zeros(1, np.float32)[::-1]"]
)
def test_values_of_another_kind_or_number_are_an_error(returned, host, python_folders, tmp_path):
    folder = altered(python_folders, tmp_path, HOOKS["get_real"], f"        return {returned}\n{HOOKS['get_real']}")
    done = call(host, folder, "freed")
    if "float32" in returned:
        assert done.returncode == 0 and done.stdout == "0x0p+0\n"  # one number, if not of C's type
    else:
        assert done.returncode == 1 and "fmi2GetReal: does not hold" in done.stderr and "fault in" in done.stderr


def test_what_a_slave_prints_appears(host, python_folders, tmp_path):
    line = HOOKS["do_step"]
    folder = altered(python_folders, tmp_path, line, f"        print('a step, ü', flush=False)\n{line}")
    done = call(host, folder, "kept", LC_ALL="C")
    assert done.returncode == 0 and done.stdout.count("a step, ") == STEPS


def main(interpreters: list[str]) -> None:
    """All scenes, ways and names by all interpreters."""
    from tensegrity_core.scene import builtin_scenes

    with tempfile.TemporaryDirectory() as scratch:
        base, count = Path(scratch), 0
        compiled(base)
        folders = {}
        for name in builtin_scenes():
            with zipfile.ZipFile(pack_python_fmu(scene(name), base / f"{name}.fmu")) as archive:
                archive.extractall(base / name)
            folders[name] = base / name
        for interpreter in interpreters or [sys.executable]:
            for name, folder in folders.items():
                for way in ALONE:
                    more = more_of(way, folder, base)
                    runs(base / "host", folder, way, *more, scene_name=name, TENSEGRITY_PYTHON=interpreter)
                    count += 1
            print(f"{interpreter}: {count} runs", flush=True)
            for k, odd in enumerate(NAMES):
                copy = shutil.copytree(folders["two_bar"], base / str(k) / odd)
                for locale in ("C", "C.UTF-8"):
                    for location in (None, str(copy / "resources")):
                        place = {"location": location, "original": folders["two_bar"]}
                        runs(base / "host", copy, "freed", TENSEGRITY_PYTHON=interpreter, LC_ALL=locale, **place)
                        count += 1
                shutil.rmtree(base / str(k))
            print(f"{interpreter}: {count} runs", flush=True)


if __name__ == "__main__":
    main(*words(__doc__, interpreters=[]))
