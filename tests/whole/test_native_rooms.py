"""Where the kernel's files stand and which of them may include which: design rules of native/, held on the sources as they are
and tried on sources that break them."""

from __future__ import annotations

import os
import re
import subprocess
from graphlib import CycleError, TopologicalSorter
from pathlib import Path, PurePosixPath

import pytest

from tensegrity_core.fields import METHODS
from tensegrity_core.native import build

#: Headers whose declarations are defined elsewhere than beside them: the public calls, and the tables of the methods.
SHARED = {"tensegrity.h", "methods/method.h"}

#: Names that the system's headers give, as far as the kernel uses them.
SYSTEM = {
    "float.h": r"DBL_\w+",
    "math.h": r"INFINITY|NAN|isfinite|f(?:abs|min|max)|sqrt|ceil|floor|frexp|ldexp|ilogb",
    "stddef.h": r"size_t|NULL|offsetof",
    "stdint.h": r"u?int(?:8|16|32|64)_t|U?INT(?:8|16|32|64)_(?:MAX|MIN)",
    "stdio.h": r"snprintf|f?printf|stderr|FILE",
    "stdlib.h": r"(?:m|c|re)alloc|free|qsort|abs|abort",
    "string.h": r"mem(?:cpy|set|move|cmp)|str(?:n?cpy|n?cmp|len)",
}

INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
FUNCTION = re.compile(r"^(?!static\b|typedef\b|ALWAYS_INLINE\b|APART\b|#)[A-Za-z][\w ]*[ *](\w+)\([^;{}]*\)\s*\{", re.MULTILINE)
DECLARED = re.compile(r"^(?!static\b|typedef\b|ALWAYS_INLINE\b|#)[A-Za-z][\w ]*[ *](\w+)\([^;{}]*\);", re.MULTILINE)
#: Macros and inline functions.
INLINE = re.compile(r"^(?:#define (\w+)|ALWAYS_INLINE [^\n;=(]*?\b(\w+)\()", re.MULTILINE)


def plain(text: str) -> str:
    """A source without comments."""
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """Path below native/ -> text without comments."""
    paths = [Path(folder, name) for folder, _, names in os.walk(build.HERE) for name in names]
    texts = {path: path.read_text(encoding="utf-8") for path in paths if path.suffix in build.SOURCES}
    return {path.relative_to(build.HERE).as_posix(): plain(text) for path, text in sorted(texts.items())}


def order(name: str) -> int | None:
    return build.ORDERS.get(PurePosixPath(name).parent.as_posix())


def upward(sources: dict[str, str]) -> list[str]:
    """Files without an order, includes of what is not there, and includes against the order."""
    found = [f"{name} is in a folder without an order" for name in sources if order(name) is None]
    for name, text in sources.items():
        for other in INCLUDE.findall(text):
            if other not in sources:
                found.append(f"{name} includes {other}, which native/ has not")
            elif (order(other) or 0) < (order(name) or 0):
                found.append(f"{name} includes {other}")
    return found


def circle(sources: dict[str, str]) -> list[str]:
    """Units that use each other, a unit being a source with its header; [] where there are none."""
    unit = {name: name if name.endswith(".def") else str(PurePosixPath(name).with_suffix("")) for name in sources}
    graph: dict[str, set[str]] = {one: set() for one in unit.values()}
    for name, text in sources.items():
        graph[unit[name]] |= {unit[other] for other in INCLUDE.findall(text) if other in sources} - {unit[name]}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def undeclared(sources: dict[str, str]) -> list[str]:
    """Functions for other files that neither the header beside their source nor the public one declares, and declarations that
    no source beside them fulfils."""
    found, public = [], set(DECLARED.findall(sources["tensegrity.h"]))
    for name, text in sources.items():
        if not name.endswith(".c"):
            continue
        beside = f"{name.removesuffix('.c')}.h"
        offered, own = set(FUNCTION.findall(text)), set(DECLARED.findall(sources.get(beside, "")))
        found += [f"{name}: {function} is declared nowhere" for function in sorted(offered - own - public)]
        found += [f"{beside}: {function} is not in {name}" for function in sorted(own - offered)]
        if own and beside not in INCLUDE.findall(text):
            found.append(f"{name} does not include its header")
    for name, text in sources.items():
        if name.endswith(".h") and name not in SHARED and f"{name.removesuffix('.h')}.c" not in sources:
            found += [f"{name}: {function} has no source beside it" for function in DECLARED.findall(text)]
    return found


def inline(text: str) -> set[str]:
    """Macros and inline functions of a file."""
    return {name for pair in INLINE.findall(text) for name in pair if name}


def names(text: str) -> set[str]:
    """All that a header offers."""
    found = set(DECLARED.findall(text)) | inline(text)
    found |= set(re.findall(r"^\} (\w+);", text, re.MULTILINE)) | set(re.findall(r"^struct (\w+) \{", text, re.MULTILINE))
    found |= set(re.findall(r"^typedef [^;{]*?\b(\w+)(?: __attribute__.*)?;", text, re.MULTILINE))
    found |= set(re.findall(r"^static const \w+ (\w+)", text, re.MULTILINE)) | set(re.findall(r"\bX\((TS_\w+),", text))
    for body in re.findall(r"\benum\s*\w*\s*\{(.*?)\}", text, re.DOTALL):
        found |= set(re.findall(r"\b[A-Z]\w+", body))
    return found - {name for name in found if name.startswith("TENSEGRITY_")}


def used(text: str) -> set[str]:
    return set(re.findall(r"\w+", re.sub(r"^#include.*$", "", text, flags=re.MULTILINE)))


def idle(sources: dict[str, str]) -> list[str]:
    """Headers, the kernel's and the system's, that a file includes and uses nothing of."""
    found = []
    for name, text in sources.items():
        words = used(text)
        for other in INCLUDE.findall(text):
            own = other == f"{name.removesuffix('.c')}.h"
            if other.endswith(".h") and not own and not words & names(sources.get(other, "")):
                found.append(f"{name} uses nothing of {other}")
        system = re.findall(r"^#include <([^>]+)>", text, re.MULTILINE)
        idle = [other for other in system if not any(re.fullmatch(SYSTEM[other], word) for word in words)]
        found += [f"{name} uses nothing of {other}" for other in idle]
    return found


def borrowed(sources: dict[str, str]) -> list[str]:
    """Functions and macros that a file has from a header which neither it nor its own header includes."""
    home = {}
    for name, text in sources.items():
        if name.endswith(".h") and not name.endswith("_tableau.h"):
            home |= dict.fromkeys({*DECLARED.findall(text), *inline(text)}, name)
    found = []
    for name, text in sources.items():
        if name.endswith(".def"):
            continue
        beside = f"{name.removesuffix('.c')}.h"
        near = {name, beside, *INCLUDE.findall(text), *INCLUDE.findall(sources.get(beside, ""))}
        near |= {"fields.h"} if "tensegrity.h" in near else set()  # the public header has it as a part of its own
        local = inline(text) | set(re.findall(r"^static [^\n;={]*?\b(\w+)\(", text, re.MULTILINE))
        calls = set(re.findall(r"(?<![\w.>])(\w+)\(", text)) - local
        found += [f"{name} has {call} from {home[call]}" for call in sorted(calls & set(home)) if home[call] not in near]
    return found


RULES = {"upward": upward, "circle": circle, "undeclared": undeclared, "idle": idle, "borrowed": borrowed}


@pytest.mark.parametrize("rule", RULES)
def test_the_sources_keep_the_rule(rule, sources):
    assert len(sources) > 60 and RULES[rule](sources) == []


#: What breaks a rule: the file, the text, what stands there instead; the rule, and what it says.
BROKEN = {
    "a lower room includes a higher one": (
        "motion/pieces.c",
        '#include "model/data.h"',
        '#include "model/data.h"\n#include "steps/events.h"',
        "upward",
        "motion/pieces.c includes steps/events.h",
    ),
    "a file outside of the rooms": ("elsewhere/one.c", None, "", "upward", "elsewhere/one.c is in a folder without an order"),
    "an include by the bare name": (
        "laws/fit.c",
        '"laws/curve.h"',
        '"curve.h"',
        "upward",
        "laws/fit.c includes curve.h, which native/ has not",
    ),
    "two files that use each other": (
        "laws/curve.c",
        '#include "laws/curve.h"',
        '#include "laws/curve.h"\n#include "laws/fit.h"',
        "circle",
        "laws/fit",
    ),
    "a function that no header declares": (
        "laws/fit.h",
        "double ts_fit_row(double (*force)(void *, double), void *law, double a, double w, double *row);",
        "",
        "undeclared",
        "laws/fit.c: ts_fit_row is declared nowhere",
    ),
    "a header without its source": (
        "model/model.h",
        "#endif",
        "int ts_nothing(int x);\n#endif",
        "undeclared",
        "model/model.h: ts_nothing has no source beside it",
    ),
    "a header for nothing": (
        "laws/fit.c",
        '#include "laws/curve.h"',
        '#include "laws/curve.h"\n#include "linear/blocks.h"',
        "idle",
        "laws/fit.c uses nothing of linear/blocks.h",
    ),
    "a header of the system for nothing": (
        "laws/curve.c",
        "#include <math.h>",
        "#include <float.h>\n#include <math.h>",
        "idle",
        "laws/curve.c uses nothing of float.h",
    ),
    "a function by way of another header": (
        "laws/memory/flow.c",
        '#include "laws/law.h"\n',
        "",
        "borrowed",
        "laws/memory/flow.c has ts_law_at from laws/law.h",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_the_rule_finds_what_breaks_it(case, sources):
    name, there, instead, rule, said = BROKEN[case]
    assert there is None or there in sources[name]
    broken = sources | {name: instead if there is None else sources[name].replace(there, instead, 1)}
    assert said in RULES[rule](broken)


def test_all_sources_are_compiled_and_watched(sources):
    assert {path.relative_to(build.HERE).as_posix() for path in build.kernel_sources()} == {
        n for n in sources if n.endswith(".c")
    }
    watched = {path.relative_to(build.HERE).as_posix() for path in build.reads("kernel") if path.suffix in build.SOURCES}
    assert watched == set(sources)


def test_every_source_has_its_header_or_serves_a_shared_one(sources):
    alone = {name for name in sources if name.endswith(".c") and f"{name.removesuffix('.c')}.h" not in sources}
    methods = {f"methods/{name}.c" for name in METHODS if name != "auto"}
    assert {name for name in alone if not name.startswith("interface/")} == methods
    public = set(DECLARED.findall(sources["tensegrity.h"]))
    for name in alone:
        offered = set(FUNCTION.findall(sources[name]))
        assert offered <= public and bool(offered) == (name not in methods)


def test_names_of_files_are_unique_so_that_sources_fit_into_one_folder(sources):
    assert len({PurePosixPath(name).name for name in sources}) == len(sources)


def test_every_header_stands_by_itself(sources, tmp_path):
    """Included first, and twice: it brings what it needs and guards itself."""
    command = build.system_compiler() or build.zig()
    files = []
    for n, name in enumerate(sorted(name for name in sources if name.endswith(".h"))):
        files.append(tmp_path / f"{n}.c")
        text = f'#include "{name}"\n' * (1 if name.endswith("_tableau.h") else 2)
        files[-1].write_text(text + "typedef int not_empty;\n", encoding="utf-8")
    line = [*command, "-std=c99", "-pedantic-errors", "-fsyntax-only", f"-I{build.HERE}", *map(str, files)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]


def test_the_public_header_is_all_that_a_host_needs(sources):
    assert set(INCLUDE.findall(sources["tensegrity.h"])) == {"fields.h", "errors.def"}
    assert not INCLUDE.findall(sources["fields.h"]) + INCLUDE.findall(sources["errors.def"])
