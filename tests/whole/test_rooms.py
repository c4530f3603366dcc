"""The rooms of the project: who may import whom, and what no module does (private names of another room, circles, edits of
sys.path).  Imports are read from the sources; nothing is run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("tensegrity_core", "fmu_src", "benchmarks")

#: Floors from below: a room uses rooms of lower floors only, and itself.  Rooms of one floor do not know each other.
FLOORS = (
    ("tensegrity_core",),  # the package's own docstring and version
    ("tensegrity_core.errors", "tensegrity_core.interrupts"),
    ("tensegrity_core.progress",),
    (
        "tensegrity_core.quantities",
        "tensegrity_core.files",
        "tensegrity_core.processes",
        "tensegrity_core.places",
        "tensegrity_core.native",
    ),
    ("tensegrity_core.fields",),
    ("tensegrity_core.model",),
    ("tensegrity_core.laws", "tensegrity_core.kernel", "tensegrity_core.scene"),
    ("tensegrity_core.reference", "tensegrity_core.statics"),
    ("tensegrity_core.equilibria",),
    ("tensegrity_core.output",),
    ("tensegrity_core.interchange",),
    ("tensegrity_core.api",),
    ("tensegrity_core.article",),
    ("tensegrity_core.commands",),  # which name the subcommand `build` only as a module that they load
    ("tensegrity_core.cli",),
    ("tensegrity_core.__main__",),
    ("fmu_src", "fmu_src.places"),
    ("fmu_src.variables",),
    ("fmu_src.packing",),
    ("fmu_src.validation",),
    ("fmu_src.builds",),
    ("fmu_src.build", "fmu_src.doctor", "fmu_src.run"),
    ("benchmarks", "benchmarks.harness"),
    ("benchmarks.peers",),
    (
        "benchmarks.stability",
        "benchmarks.article",
        "benchmarks.speed",
        "benchmarks.work_precision",
        "benchmarks.importers",
        "benchmarks.ground",
    ),
    ("benchmarks.coupling", "benchmarks.exchange"),
    ("benchmarks.redraw",),
)
#: What stands in an FMU, or in an importer's environment, and imports what is there.
ELSEWHERE = (
    "fmu_src.python_runtime",
    "benchmarks.importers.drivers",
    "benchmarks.coupling.drivers",
    "benchmarks.exchange.drivers",
)
#: Never imported by the room before them, whatever the floors say: the two truths meet in tests and in validation only.
APART = {
    "tensegrity_core.kernel": ("tensegrity_core.laws", "tensegrity_core.reference"),
    "tensegrity_core.native": ("tensegrity_core.laws", "tensegrity_core.reference"),
    "tensegrity_core.reference": ("tensegrity_core.kernel", "tensegrity_core.native"),
}
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}


def modules() -> dict[str, Path]:
    """Name -> file of every module of the packages."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(name: str, path: Path, top: bool = False):
    """(line, module, imported name or None) of every import of the project's own modules; top: of those that run at import."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    within = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in tree.body if top else ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] in PACKAGES:
                    yield node.lineno, alias.name, None
        elif isinstance(node, ast.ImportFrom):
            above = within[: len(within) - node.level + 1] if node.level else []
            module = ".".join([*above, *filter(None, [node.module])])
            if module.split(".")[0] in PACKAGES:
                for alias in node.names:
                    whole = f"{module}.{alias.name}"
                    yield (node.lineno, whole, None) if whole in MODULES else (node.lineno, module, alias.name)


def room(module: str) -> str:
    """The longest name of a room that a module stands in."""
    parts = module.split(".")
    return next(r for r in (".".join(parts[:n]) for n in range(len(parts), 0, -1)) if r in FLOOR or r in ELSEWHERE)


HERE = [name for name in MODULES if not name.startswith(ELSEWHERE)]


def test_every_folder_is_a_room():
    """Modules beside the rooms have a floor of their own: a new one needs its line above."""
    for name in HERE:
        assert name in FLOOR or room(name) not in PACKAGES, f"{name}: give it a room, or a floor in FLOORS"


@pytest.mark.parametrize("name", HERE)
def test_a_room_uses_rooms_below_it(name):
    mine = room(name)
    for line, module, _ in imports(name, MODULES[name]):
        theirs = room(module)
        assert theirs == mine or FLOOR[theirs] < FLOOR[mine], (
            f"{MODULES[name]}:{line}: {mine} imports {theirs}, which is not below it"
        )
        assert theirs not in APART.get(mine, ()), f"{MODULES[name]}:{line}: {mine} must not know {theirs}"


@pytest.mark.parametrize("name", HERE)
def test_private_names_stay_in_their_room(name):
    path = MODULES[name]
    tree, whole = ast.parse(path.read_text(encoding="utf-8")), {}
    for line, module, what in imports(name, path):
        if what and what.startswith("_") and not what.startswith("__"):
            assert room(module) == room(name), f"{path}:{line}: {module}.{what} is private"
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            whole |= {alias.asname or alias.name: alias.name for alias in node.names}
    others = {local for local, what in whole.items() if any(m == what or m.endswith(f".{what}") for m in MODULES)}
    mine = {module.rpartition(".")[2] for module in MODULES if room(module) == room(name)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr.startswith("_"):
            local = node.value.id
            if local in others and whole[local] not in mine and not node.attr.startswith("__"):
                assert not bound(tree, local), f"{path}:{node.lineno}: {local}.{node.attr} is private"


def bound(tree: ast.AST, name: str) -> bool:
    """Whether a name stands for something else than a module somewhere in a file."""
    stored = (isinstance(n, ast.Name) and n.id == name and isinstance(n.ctx, ast.Store) for n in ast.walk(tree))
    return any(stored) or any(isinstance(n, ast.arg) and n.arg == name for n in ast.walk(tree))


def test_modules_do_not_import_in_circles():
    """At import time; a package stands for the modules that it imports."""
    edges = {name: {m for _, m, _ in imports(name, MODULES[name], top=True)} - {name} for name in HERE}
    done: set[str] = set()

    def visit(name: str, way: tuple[str, ...]) -> None:
        assert name not in way, f"a circle: {' -> '.join([*way[way.index(name) :], name])}"
        if name not in done:
            for other in sorted(edges.get(name, ())):
                visit(other, (*way, name))
            done.add(name)

    for name in HERE:
        visit(name, ())


def test_nobody_edits_the_search_path():
    """But for benchmarks/speed/unused_parts.py, which imports an older copy of the core."""
    edits = []
    for path in [*MODULES.values(), *sorted((ROOT / "tests").rglob("*.py")), ROOT / "build_fmu.py"]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            used = isinstance(node, ast.Attribute) and node.attr == "path" and getattr(node.value, "id", "") == "sys"
            if used and (isinstance(node.ctx, ast.Store) or path.stem != "test_python_host"):
                edits.append(f"{path.relative_to(ROOT).as_posix()}:{node.lineno}")
    assert [edit.partition(":")[0] for edit in edits] == ["benchmarks/speed/unused_parts.py"], edits
