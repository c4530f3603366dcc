"""Writers: whole or not at all, whatever else happens in the folder, and all of them through one module."""

from __future__ import annotations

import ast
import errno
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from fmu_src.packing.pack import write_zip
from fmu_src.validation.reference_cache import write as write_cached
from tensegrity_core import files
from tensegrity_core.errors import InputError
from tensegrity_core.files import replacing, replacing_folder, replacing_text, scratch, write_bytes, write_text
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output.export import write_columns, write_result
from tensegrity_core.output.film import write_frames
from tensegrity_core.output.plots import new_figure, write_figure
from tests.support import scene

ROOT = Path(__file__).resolve().parents[2]
posix = pytest.mark.skipif(os.name == "nt", reason="of systems with locks, links and umask")


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("old", encoding="utf-8")
    with pytest.raises(ZeroDivisionError), replacing_text(path) as file:
        file.write("half")
        raise ZeroDivisionError
    assert content(tmp_path) == {"run.csv": "old"}
    with replacing_text(path) as file:
        file.write("new")
        assert path.read_text(encoding="utf-8") == "old"
    assert content(tmp_path) == {"run.csv": "new"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError, OSError])
def test_nothing_stays_whatever_ends_the_block(error, tmp_path):
    with pytest.raises(InputError if error is OSError else error), replacing(tmp_path / "one") as file:
        file.write(b"half")
        raise error("no space")
    with pytest.raises(InputError if error is OSError else error), replacing_folder(tmp_path / "two" / "three") as folder:
        (folder / "half").touch()
        raise error("no space")
    with pytest.raises(error), scratch(tmp_path):
        raise error
    assert [path.name for path in tmp_path.rglob("*")] == ["two"]


def test_what_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for path in (tmp_path / "missing" / "one.csv", tmp_path / "file" / "one.csv"):
        with pytest.raises(InputError, match=r"one\.csv' cannot be written: .*; name another file"):
            write_text(path, "text")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="folder' cannot be written"):
        write_text(tmp_path / "folder", "text")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


@posix
@pytest.mark.parametrize("mask", [0o022, 0o077, 0o027, 0o002])
def test_permissions_are_the_usual_ones(mask, tmp_path):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "file", "text")
        with replacing_folder(tmp_path / "folder"):
            pass
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o666 & ~mask
    assert (tmp_path / "folder").stat().st_mode & 0o777 == 0o777 & ~mask


@posix
def test_links_are_not_followed(tmp_path, monkeypatch):
    """Neither one at the place itself, nor one under the name that the temporary file would have."""
    victim = tmp_path / "victim"
    victim.write_text("untouched", encoding="utf-8")
    (tmp_path / "link").symlink_to(victim)
    write_text(tmp_path / "link", "new")
    assert not (tmp_path / "link").is_symlink() and victim.read_text(encoding="utf-8") == "untouched"
    monkeypatch.setattr(files.secrets, "token_hex", lambda count: "0" * 2 * count)
    (tmp_path / f".tensegrity-{'0' * 16}.tmp").symlink_to(victim)
    with pytest.raises(InputError, match="exists"):
        write_text(tmp_path / "other", "new")
    assert victim.read_text(encoding="utf-8") == "untouched" and not (tmp_path / "other").exists()


# --- leftovers -----------------------------------------------------------------------------------------------------

HOLD = """
import sys, time
from pathlib import Path
from tensegrity_core.files import replacing, scratch
with replacing(Path(sys.argv[1]) / "big.csv") as file, scratch(sys.argv[1]) as folder:
    file.write(b"half")
    (folder / "half").touch()
    print("writing", flush=True)
    sys.stdin.read()
"""


def writer(folder: Path) -> subprocess.Popen:
    """A process that has written half a file and half a folder."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], cwd=ROOT, **pipes)
    assert process.stdout.readline() == "writing\n"
    return process


@posix
def test_the_next_writer_removes_what_a_killed_one_left(tmp_path):
    with writer(tmp_path) as killed, writer(tmp_path) as alive:
        assert len(list(tmp_path.iterdir())) == 4
        killed.kill()
        killed.wait()
        write_text(tmp_path / "mine", "text")
        assert len(list(tmp_path.iterdir())) == 3  # two of the one that lives
        alive.stdin.close()
        assert alive.wait() == 0
    assert content(tmp_path) == {"mine": "text", "big.csv": "half"}


@posix
def test_what_is_not_ours_stays(tmp_path):
    """Other names, links that are called as ours, and folders that are being made."""
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "owner").touch()
    names = [".tensegrity-1.tmp", ".tensegrity-0123456789abcdeg.tmp", "tensegrity-0123456789abcdef.tmp", ".a-1234.csv"]
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / ".tensegrity-0123456789abcdef.tmp").symlink_to(victim)
    (tmp_path / ".tensegrity-0123456789abcde0.tmp").symlink_to(victim / "owner")
    (tmp_path / ".tensegrity-0123456789abcde1.tmp").mkdir()
    before = sorted(tmp_path.rglob("*"))
    files.remove_leftovers(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before


@posix
def test_a_new_file_that_is_taken_for_a_leftover_is_made_anew(tmp_path, monkeypatch):
    """Between making a file and locking it, another process may remove it."""
    plain, taken = files.locked, []

    def slow(handle):
        if not taken:
            taken.extend(path.name for path in tmp_path.iterdir())
            files.remove_leftovers(tmp_path)
        return plain(handle)

    monkeypatch.setattr(files, "locked", slow)
    write_text(tmp_path / "mine", "text")
    assert len(taken) == 1 and content(tmp_path) == {"mine": "text"}


def test_without_locks_only_what_is_old_and_closed_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "fcntl", None)
    fresh, old = (tmp_path / f".tensegrity-{digit * 16}.tmp" for digit in "01")
    for path in (fresh, old):
        path.touch()
    os.utime(old, (0, 0))
    write_text(tmp_path / "mine", "text")
    assert sorted(path.name for path in tmp_path.iterdir()) == [fresh.name, "mine"]


# --- many at once --------------------------------------------------------------------------------------------------

WRITERS, ROUNDS, SIZE = 6, 20, 20_000
OFTEN = """
import sys
from pathlib import Path
from tensegrity_core.files import replacing_folder, write_bytes
folder, number, rounds, size = Path(sys.argv[1]), *map(int, sys.argv[2:])
for _ in range(rounds):
    write_bytes(folder / "shared", bytes([number]) * size)
    with replacing_folder(folder / "both") as fresh:
        for name in ("one", "two"):
            (fresh / name).write_bytes(bytes([number]))
"""


def test_many_writers_of_one_file(tmp_path):
    """Whoever reads sees the whole content of one of them; at the end nothing else is there."""
    write_bytes(tmp_path / "shared", bytes([0]) * SIZE)
    numbers = [[str(number), str(ROUNDS), str(SIZE)] for number in range(1, WRITERS + 1)]
    writers = [subprocess.Popen([sys.executable, "-c", OFTEN, str(tmp_path), *words], cwd=ROOT) for words in numbers]
    reads = 0
    while any(process.poll() is None for process in writers):
        found = (tmp_path / "shared").read_bytes()
        assert len(found) == SIZE and len(set(found)) == 1
        reads += 1
    for process in writers:
        assert process.wait() == 0
    assert reads > 0 and sorted(path.name for path in tmp_path.iterdir()) == ["both", "shared"]
    assert (tmp_path / "both" / "one").read_bytes() == (tmp_path / "both" / "two").read_bytes()


def test_a_folder_that_another_writer_takes_away_in_between(tmp_path, monkeypatch):
    """It was there when this one was to take its place, and is not when one looks why that failed."""
    both, rename = tmp_path / "both", os.rename
    both.mkdir()
    (both / "before").touch()

    def meanwhile(old, new):
        if Path(new) == both and both.exists():
            with pytest.raises(OSError):
                rename(old, new)
            shutil.rmtree(both)
            raise OSError(errno.ENOTEMPTY, "Directory not empty")
        rename(old, new)

    monkeypatch.setattr(os, "rename", meanwhile)
    with replacing_folder(both) as fresh:
        (fresh / "after").touch()
    assert [path.name for path in both.iterdir()] == ["after"] and list(tmp_path.iterdir()) == [both]


# --- all writers ---------------------------------------------------------------------------------------------------


def write_film(path):
    write_frames(new_figure(100, 100), path, 2, lambda i: None, 10)


def run():
    model = scene("two_bar")
    return model, simulate(model, held(model, grid(0.02, 0.01)))


#: The library's writers, by the kind of file.
KINDS = {
    "run.csv": lambda path: write_result(*run(), path),
    "run.npz": lambda path: write_result(*run(), path),
    "columns.csv": lambda path: write_columns({}, path),
    "figure.png": lambda path: write_figure(new_figure(100, 100), path),
    "figure.svg": lambda path: write_figure(new_figure(100, 100), path),
    "film.gif": write_film,
    "one.fmu": lambda path: write_zip(path, {"modelDescription.xml": b""}),
    "reference.bin": lambda path: write_cached(path, b"result"),
}


@posix
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_file_is_written_that_way(name, tmp_path, monkeypatch):
    """A link at the place is replaced; where the disk is full nothing changes and the error is one of the project's."""
    victim, path = tmp_path / "victim", tmp_path / name
    victim.write_text("untouched", encoding="utf-8")
    path.symlink_to(victim)
    KINDS[name](path)
    assert not path.is_symlink() and victim.read_text(encoding="utf-8") == "untouched"
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left on device"):
        KINDS[name](path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    if name.endswith(".fmu"):
        assert zipfile.ZipFile(path).namelist() == ["modelDescription.xml"]


#: Programs that run where the project is not installed, in a scratch folder of their caller; and a build hook, which compiles
#: into a fresh folder before there is a package.
ELSEWHERE = {
    "tensegrity_core/files.py",
    "tensegrity_core/native/build.py",
    "tensegrity_core/output/page/bundle.py",  # it runs in the build, too
    "fmu_src/validation/outside.py",
    *(path.relative_to(ROOT).as_posix() for path in (ROOT / "benchmarks").glob("*/drivers/*.py")),
}
#: Methods and functions that write to a path, and the arguments' place of what must not be one.
WRITE = dict.fromkeys(("savefig", "imsave", "save", "savez", "savez_compressed", "savetxt", "tofile", "to_csv"), 0) | {
    "dump": 1
}
#: Calls that have no place outside of files.py.
NEVER = {
    "tempfile": {"mkstemp", "mkdtemp", "NamedTemporaryFile", "TemporaryFile", "TemporaryDirectory"},
    "shutil": {"copy", "copy2", "copyfile", "copytree", "move"},
    "os": {"replace", "rename", "renames", "link", "symlink"},
}


def sources() -> list[Path]:
    folders = [ROOT / name for name in ("tensegrity_core", "fmu_src", "benchmarks")]
    found = [*ROOT.glob("*.py"), *(path for folder in folders for path in folder.rglob("*.py"))]
    return sorted(path for path in found if path.relative_to(ROOT).as_posix() not in ELSEWHERE)


def unguarded(tree: ast.AST) -> list[str]:
    """Calls in a module that write past files.py.  A name bound by `with replacing(...) as name`, or to a buffer in memory, may
    be written to."""
    safe, found = set(), []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and {alias.name for alias in node.names} & NEVER.get(node.module, set()):
            found.append(node)
        bound = isinstance(node, ast.withitem) and isinstance(node.optional_vars, ast.Name) and node.context_expr
        if isinstance(bound, ast.Call) and called(bound) in ("replacing", "replacing_text"):
            safe.add(node.optional_vars.id)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and called(node.value) in ("BytesIO", "StringIO"):
            safe |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            for target, value in zip(getattr(node.targets[0], "elts", ()), node.value.elts):
                if isinstance(value, ast.Call) and called(value) in ("BytesIO", "StringIO"):
                    safe.add(target.id)
    found += [node for node in ast.walk(tree) if isinstance(node, ast.Call) and writes(node, safe)]
    return [f"line {node.lineno}: {ast.unparse(node)[:80]}" for node in found]


def called(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")


def writes(node: ast.Call, safe: set[str]) -> bool:
    name, method = called(node), isinstance(node.func, ast.Attribute)
    owner = node.func.value.id if method and isinstance(node.func.value, ast.Name) else ""
    if name in NEVER.get(owner, ()):
        return True
    if name == "open" and ast.unparse(node).startswith("os.open(os.devnull,"):
        return False
    if name == "open":
        place = 0 if method and owner not in ("io", "gzip", "tarfile", "os", "Image") else 1
        modes = [*node.args[place : place + 1], *(word.value for word in node.keywords if word.arg == "mode")]
        known = [mode.value for mode in modes if isinstance(mode, ast.Constant)]
        return owner != "Image" and (len(known) < len(modes) or any(set(mode) & set("wax+") for mode in known))
    if name in ("write_text", "write_bytes"):
        return method and owner != "files"
    if name == "ZipFile":
        return len(node.args) > 1 and not stands(node.args[0], safe)
    if name == "dump" and owner not in ("json", "pickle", "toml"):
        return False
    if name in WRITE:
        arguments = node.args[WRITE[name] : WRITE[name] + 1]
        return method and bool(arguments) and owner != "data" and not stands(arguments[0], safe)
    return False


def stands(argument: ast.AST, safe: set[str]) -> bool:
    return isinstance(argument, ast.Name) and argument.id in safe


def test_all_writers_go_through_one_module():
    found = {path.relative_to(ROOT).as_posix(): unguarded(ast.parse(path.read_text(encoding="utf-8"))) for path in sources()}
    assert len(found) > 90
    assert {name: calls for name, calls in found.items() if calls} == {}


@pytest.mark.parametrize(
    "code",
    [
        "open(p, 'w')",
        "open(p, mode='a')",
        "open(p, mode)",
        "p.open('x')",
        "p.write_text('t')",
        "p.write_bytes(b'')",
        "os.replace(a, b)",
        "figure.savefig(p)",
        "few.save(p, optimize=True)",
        "np.savez(p, a=a)",
        "np.savetxt(p, a)",
        "a.tofile(p)",
        "json.dump(a, p)",
        "zipfile.ZipFile(p, 'w')",
        "tempfile.mkstemp()",
        "from tempfile import mkstemp",
        "tempfile.TemporaryDirectory()",
        "shutil.copy(a, b)",
        "shutil.move(a, b)",
    ],
)
def test_the_search_finds_writers(code):
    assert len(unguarded(ast.parse(code))) == 1


@pytest.mark.parametrize(
    "code",
    [
        "open(p)",
        "open(p, encoding='utf-8')",
        "p.open(newline='')",
        "with replacing(p) as f: np.savez(f, a=a)",
        "files.write_text(p, 't')",
        "out = io.BytesIO()\nfigure.savefig(out)",
        "text.replace('a', 'b')",
        "Image.open(p, 'r')",
        "write_text(p, 't')",
    ],
)
def test_the_search_passes_what_is_right(code):
    assert unguarded(ast.parse(code)) == []
