"""Run by the FMU's library at each instantiation, which takes `bridge` from here.

The modules have private names, so that FMUs of several versions run in one process; nothing is put on sys.path.  In the source
tree this is a template: pack.py fills the name in.
"""

import hashlib
import importlib
import importlib.util
import os
import sys

PRIVATE = "@PRIVATE@"
FOLDER = os.path.dirname(os.path.abspath(__file__))


class Refused(Exception):
    """What the host is told."""


def check():
    """Refuse files that differ from those that were built; without the list of them nothing is checked."""
    if not os.path.lexists(os.path.join(FOLDER, "checksums.txt")):
        return
    head, *lines = content("checksums.txt").decode("ascii", "replace").split("\n")
    if head != f"# {len(lines) - 1} files" or lines[-1]:
        raise Refused("resources/checksums.txt is damaged; unzip the FMU anew")
    for line in lines[:-1]:
        digest, _, name = line.partition("  ")
        if hashlib.sha256(content(name)).hexdigest() != digest:
            remedy = "unzip the FMU anew, or, if you changed the file, remove resources/checksums.txt"
            raise Refused(f"resources/{name} differs from what was built; {remedy}")


def content(name):
    """Of a file in the resources."""
    try:
        with open(os.path.join(FOLDER, name), "rb") as file:
            return file.read()
    except (OSError, ValueError) as error:
        raise Refused(f"{os.path.join(FOLDER, name)} cannot be read; unzip the FMU anew") from error


def loaded():
    """The module `bridge`, with all that it imports, from the files that were checked: no cache of Python's is read or left."""
    before = sys.dont_write_bytecode, sys.pycache_prefix
    sys.dont_write_bytecode, sys.pycache_prefix = True, os.path.join(FOLDER, "no cache")
    try:
        package()
        return importlib.import_module(PRIVATE + ".python_runtime.bridge")
    finally:
        sys.dont_write_bytecode, sys.pycache_prefix = before


def package():
    """The private package in sys.modules, by whichever of its FMUs came first."""
    if PRIVATE not in sys.modules:
        folder = os.path.join(FOLDER, PRIVATE)
        start = os.path.join(folder, "__init__.py")
        spec = importlib.util.spec_from_file_location(PRIVATE, start, submodule_search_locations=[folder])
        if spec is None or spec.loader is None:
            raise ImportError(f"{start} is no Python file that can be imported")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        sys.modules.setdefault(PRIVATE, module)


check()
try:
    import numpy  # noqa: F401 (whether it is there; the bridge imports it)
except ImportError as error:
    version = ".".join(map(str, sys.version_info[:2]))
    raise ImportError(f"NumPy is missing in Python {version} of {sys.prefix} ({error}): pip install numpy there") from error
bridge = loaded()
