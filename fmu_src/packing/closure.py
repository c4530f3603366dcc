"""Which source files a module of this project needs: its imports within the package, followed to the end."""

from __future__ import annotations

import ast
import sys
from pathlib import Path


def import_closure(package: Path, *modules: str) -> tuple[list[Path], set[str]]:
    """Files of `package` (a folder) that its modules of these names (with dots below the package) import, themselves and the
    packages they stand in included, and the names of other packages outside the standard library.  Looks at import statements
    anywhere in the files, relative or by full name.
    """
    files: set[Path] = set()
    foreign: set[str] = set()
    todo = [package.name, *(f"{package.name}.{module}" for module in modules)]
    while todo:
        name = todo.pop()
        path = _file(package, name)
        if path is None or path in files:
            continue
        files.add(path)
        todo.append(name.rpartition(".")[0])
        within = name if path.name == "__init__.py" else name.rpartition(".")[0]
        for module, names in _imports(path, within):
            if module.split(".")[0] == package.name:
                todo += [module, *(f"{module}.{name}" for name in names)]
            elif module.split(".")[0] not in sys.stdlib_module_names:
                foreign.add(module.split(".")[0])
    return sorted(files), foreign


def _file(package: Path, module: str) -> Path | None:
    """Of a module by its full name; None: what is imported is no module."""
    place = package.parent.joinpath(*module.split("."))
    return next((path for path in (place / "__init__.py", place.with_suffix(".py")) if path.is_file()), None)


def _imports(path: Path, within: str):
    """(module by its full name, names imported from it) for each import statement of a file; within: the package it stands
    in."""
    for node in ast.walk(_parsed(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, []
        elif isinstance(node, ast.ImportFrom):
            above = within.split(".")[: len(within.split(".")) - node.level + 1] if node.level else []
            yield ".".join([*above, *filter(None, [node.module])]), [alias.name for alias in node.names]


def _parsed(path: Path) -> ast.Module:
    """Python 3.11 may fail where its garbage collection, or another thread, parses something else meanwhile: then again."""
    text = path.read_text(encoding="utf-8")
    try:
        return ast.parse(text, str(path))
    except SystemError:
        return ast.parse(text, str(path))
