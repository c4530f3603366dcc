"""How the project writes: every file and folder appears whole or not at all, and nothing else is touched.

A file is written under a name of its own beside its place, which nobody can have planted a link at, and is renamed into it.
Readers, and other writers of the same file, see one whole file or another.  The writer holds a lock on what is temporary for as
long as it lives: what is not locked was left by one that was killed, and the next to write in that folder removes it.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, TextIO

from .errors import InputError
from .interrupts import held_back

try:
    import fcntl
except ModuleNotFoundError:  # Windows, where a file that is open cannot be removed
    fcntl = None  # type: ignore[assignment]

#: What is temporary is called so, files and folders alike.
TEMPORARY = re.compile(r"\.tensegrity-[0-9a-f]{16}\.tmp")
#: In a temporary folder: the file that its owner has locked, and the folder that the owner fills.
OWNER, FILLED = "owner", "files"
#: Without locks: how long after its last change something that nobody has open counts as left behind, s.
ABANDONED = 3600.0

#: A folder cannot be renamed to a place where there is another.
_TAKEN = (errno.ENOTEMPTY, errno.EEXIST, *(() if fcntl else (errno.EACCES,)))

_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL
_HARMLESS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


@contextmanager
def replacing(path: str | Path) -> Iterator[BinaryIO]:
    """A new binary file that takes the place of `path` when the block ends well, and vanishes when it does not.

    A link at `path` is replaced, not followed; permissions are the process's usual ones.  Raises InputError where nothing can
    be written there, and what stood there stays.
    """
    path = _possible(path)
    try:
        with ExitStack() as stack:
            with held_back():
                temporary, handle = _new_file(path.parent)
                stack.callback(_remove_file, temporary)
                file = stack.enter_context(os.fdopen(handle, "w+b"))
            yield file
            file.flush()
            _to_disk(file)
            if not fcntl:
                file.close()
            _rename(temporary, path)
    except OSError as failure:
        raise _not_writable(path, failure) from failure


@contextmanager
def replacing_text(path: str | Path) -> Iterator[TextIO]:
    """`replacing` for text, in UTF-8 with line feeds."""
    with replacing(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
        try:
            yield text
        finally:
            text.detach()


def write_text(path: str | Path, text: str) -> None:
    """A text as a file, see `replacing_text`."""
    write_bytes(path, text.encode())


def write_bytes(path: str | Path, content: bytes) -> None:
    """Bytes as a file, see `replacing`."""
    with replacing(path) as file:
        file.write(content)


@contextmanager
def scratch(parent: str | Path | None = None) -> Iterator[Path]:
    """A fresh folder, removed at the end; by default among the system's temporary files.  Raises OSError."""
    parent = Path(parent or tempfile.gettempdir())
    remove_leftovers(parent)
    with ExitStack() as stack:
        with held_back():
            folder, handle = _new_folder(parent)
            stack.callback(_remove_folder, folder, handle)
        yield folder / FILLED


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """An empty folder that takes the place of the folder `path` when the block ends well, and vanishes when it does not.

    Missing folders above it are made.  Raises InputError where it cannot be put there.
    """
    path = _possible(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch(path.parent) as fresh:
            yield fresh
            _exchange(fresh, path)
    except OSError as failure:
        raise _not_writable(path, failure) from failure


def remove_leftovers(folder: Path) -> None:
    """Remove what writers that were killed have left in a folder; what lives, and whatever is not ours, stays."""
    try:
        found = [Path(entry.path) for entry in os.scandir(folder) if TEMPORARY.fullmatch(entry.name)]
    except OSError:  # a folder that cannot be read hides nothing that this process could have left
        return
    for path in found:
        with contextlib.suppress(OSError):
            _remove_if_left(path)


def _remove_if_left(path: Path) -> None:
    found = path.lstat()
    if hasattr(os, "getuid") and found.st_uid != os.getuid():
        return
    if stat.S_ISREG(found.st_mode):
        _remove_unlocked(path)
    elif stat.S_ISDIR(found.st_mode):
        owner = path / OWNER
        # Without an owner a folder is being made at this moment, or being removed.
        if _remove_unlocked(owner) if owner.exists() else _is_old(found):
            shutil.rmtree(path, ignore_errors=True)


def _remove_unlocked(path: Path) -> bool:
    """Remove a file that no living process has locked; returns whether it did."""
    if not fcntl:
        if not _is_old(path.lstat()):
            return False
        path.unlink()  # refused while it is open
        return True
    handle = os.open(path, os.O_RDWR | _HARMLESS)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused while its writer lives
        path.unlink()
    finally:
        os.close(handle)
    return True


def _remove_file(path: Path) -> None:
    with held_back():
        path.unlink(missing_ok=True)
    remove_leftovers(path.parent)


def _remove_folder(folder: Path, handle: int) -> None:
    with held_back():
        if not fcntl:
            os.close(handle)
        shutil.rmtree(folder, ignore_errors=True)
        if fcntl:
            os.close(handle)


def _is_old(found: os.stat_result) -> bool:
    return time.time() - found.st_mtime > ABANDONED


def _new_file(folder: Path) -> tuple[Path, int]:
    """A new temporary file and its handle, locked."""
    while True:
        path = folder / f".tensegrity-{secrets.token_hex(8)}.tmp"
        handle = os.open(path, _NEW | _HARMLESS, 0o666)
        if locked(handle):
            return path, handle
        os.close(handle)


def _new_folder(parent: Path) -> tuple[Path, int]:
    """A new temporary folder and the handle of its owner's file, locked."""
    while True:
        folder = parent / f".tensegrity-{secrets.token_hex(8)}.tmp"
        folder.mkdir(mode=0o700)
        handle = os.open(folder / OWNER, _NEW | _HARMLESS, 0o600)
        if locked(handle):
            (folder / FILLED).mkdir()
            return folder, handle
        os.close(handle)


def locked(handle: int) -> bool:
    """Lock a new file; False where somebody took it for a leftover in the moment between."""
    if fcntl:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks: nobody else can lock it, so nobody will remove it
            return True
        return os.fstat(handle).st_nlink > 0
    return True


def _to_disk(file: BinaryIO) -> None:
    """A file that has its final name has its content, too, even after a power cut."""
    try:
        os.fsync(file.fileno())
    except OSError as failure:
        if failure.errno not in (errno.EINVAL, errno.ENOTSUP):  # file systems that know no such thing
            raise


def _rename(temporary: Path, path: Path) -> None:
    """Windows refuses for the moment in which somebody else renames to, or reads from, the same place."""
    for wait in () if fcntl else (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0):
        try:
            return os.replace(temporary, path)
        except PermissionError:
            time.sleep(wait)
    return os.replace(temporary, path)


def _exchange(fresh: Path, path: Path) -> None:
    """Put a folder in place of another.  Where several do so at once, the last one stays."""
    for attempt in range(100):
        try:
            return os.rename(fresh, path)
        except OSError as failure:
            if failure.errno not in _TAKEN or path.is_symlink() or path.is_file():
                raise  # else another folder was there at that moment, though it may be gone by now
        with contextlib.suppress(FileNotFoundError):
            os.rename(path, fresh.with_name(f"old{attempt}"))
    return os.rename(fresh, path)


def _possible(path: str | Path) -> Path:
    """Raises InputError for what no file can be called."""
    path = Path(path)
    try:
        os.lstat(path)
    except ValueError as failure:  # a null character, letters that the file system's encoding lacks
        raise _not_writable(path, failure) from failure
    except OSError:  # it is not there, which writing will mend, or writing will say what is wrong
        pass
    return path


def _not_writable(path: Path, failure: OSError | ValueError) -> InputError:
    return InputError(
        f"output = {str(path)!r} cannot be written: {getattr(failure, 'strerror', None) or failure}; name another file"
    )
