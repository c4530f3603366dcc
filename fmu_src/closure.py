"""Which source files a module of this project needs: its imports within the package, followed to the end."""

from __future__ import annotations

import ast
import sys
from pathlib import Path


def import_closure(package: Path, *modules: str) -> tuple[list[Path], set[str]]:
    """Files of `package` (a folder) that its modules of these names import, themselves included, and the names of other
    packages outside the standard library.  Looks at import statements anywhere in the files, relative or by full name.
    """
    files: dict[str, Path] = {}
    foreign: set[str] = set()
    todo = ["__init__", *modules]
    while todo:
        name = todo.pop()
        path = package / f"{name}.py"
        if name in files or not path.is_file():
            continue
        files[name] = path
        for module, names in _imports(path):
            inside = module is None or module.split(".")[0] == package.name
            if inside:
                rest = module.split(".")[1:] if module else []
                todo += rest[:1] or names
            elif module.split(".")[0] not in sys.stdlib_module_names:
                foreign.add(module.split(".")[0])
    return sorted(files.values()), foreign


def _imports(path: Path):
    """(module or None for the package itself, names imported from it) for each import statement of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, []
        elif isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
            if node.level == 0:
                yield node.module, names
            elif node.level == 1:
                yield f"{path.parent.name}.{node.module}" if node.module else None, names
