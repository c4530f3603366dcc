"""Random damage to scenes: each case has to be a right answer or one of the project's errors, soon and without a warning.

Built-in scenes and the scenes in README.md and docs/*.md are damaged in their bytes, their structure or their numbers; what
`check` then accepts is built, handed to the kernel and simulated for a moment.  A case is named by its number and the seed:

    python -m tests.scene.fuzz_scenes --cases 10000 --seed 0
    python -m tests.scene.fuzz_scenes --seed 0 --only 4711       # one case, with its scene and its traceback
"""

from __future__ import annotations

import argparse
import copy
import functools
import random
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output.structure_summary import summary
from tensegrity_core.scene import SCENE_FOLDER, load_scene, parse_scene
from tensegrity_core.statics import build_model

ROOT = Path(__file__).resolve().parents[2]
MOST_TIME = 5.0  # s of processor time
MOST_MEMORY = 1e9  # bytes
SIMULATED, STEP = 2e-3, 1e-3  # s

NUMBERS = [
    0,
    1,
    -1,
    0.0,
    -0.0,
    1.0,
    -1.0,
    2.0,
    8.0,
    0.5,
    1e-3,
    1e3,
    1e6,
    -1e6,
    1e9,
    1e12,
    6e12,
    1e15,
    1e16,
    1e30,
    1e154,
    1e300,
    1.8e308,
    1e-6,
    1e-9,
    1e-12,
    1e-15,
    1e-16,
    1e-30,
    1e-154,
    1e-300,
    5e-324,
    float("inf"),
    float("nan"),
    2**53 + 1,
    2**70,
    10**400,
    np.nextafter(2.0, 3.0),
    np.nextafter(8.0, 7.0),
    np.nextafter(0.0, 1.0),
]
TEXTS = [
    "",
    "n1",
    "n4",
    "s1",
    "b1",
    "energy",
    "settled",
    "released",
    "equilibrium",
    "xy",
    "xz",
    "hysteretic",
    "single_valued",
    "any",
    "series",
    "parallel",
    "beam",
    "table",
    "polynomial",
    "spring",
    "cubic",
    "tension_only",
    "cable",
    "a.b",
    "ü",
    "x" * 300,
]
FRAGMENTS = [
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b'"',
    b".",
    b"\n",
    b"#",
    b"[[",
    b"1e",
    b"0x",
    b"_",
    b"\x00",
    b"\xff",
    b"nan",
    b"-",
    b"'",
    b"\\u",
]


@functools.cache
def sources() -> dict[str, str]:
    """Name -> text of every scene; those that extend a file have it beside them."""
    found = {path.stem: path.read_text(encoding="utf-8") for path in sorted(SCENE_FOLDER.glob("*.toml"))}
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        found |= dict(re.findall(r"```toml\n# (\w+)\.toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
    return found


@functools.cache
def joined(name: str) -> dict:
    """The tables of a scene and of what it extends, in one."""
    with tempfile.TemporaryDirectory() as folder:
        for other, text in sources().items():
            (Path(folder) / f"{other}.toml").write_text(text, encoding="utf-8")
        from tensegrity_core import scene as scene_files

        return scene_files.read(Path(folder) / f"{name}.toml")[0] | {"name": name}


def places(table: Any, above: tuple = ()) -> Iterator[tuple]:
    inside = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    for key, value in inside:
        yield (*above, key)
        yield from places(value, (*above, key))


def at(table: Any, place: tuple) -> Any:
    for key in place:
        table = table[key]
    return table


def damage_numbers(raw: dict, choose: random.Random) -> None:
    numbers, mild = [p for p in places(raw) if isinstance(at(raw, p), (int, float))], choose.random() < 0.5
    if mild:  # so that more of them get further
        raw["start"] = choose.choice(["settled", "released", "equilibrium"])
    for _ in range(choose.choice([1, 1, 2, 5, len(numbers)])):
        *above, last = choose.choice(numbers)
        value, kind = at(raw, tuple(above))[last], choose.random()
        value = value if abs(value) < 1e300 else 1.0
        if mild:
            value = value * choose.choice(
                [choose.uniform(0.9, 1.1), choose.uniform(0.2, 4.0), 10.0 ** choose.uniform(-4.0, 4.0)]
            )
        elif kind < 0.5:
            value = choose.choice(NUMBERS)
        elif kind < 0.8:
            value = value * 10.0 ** choose.uniform(-12.0, 12.0)
        elif kind < 0.95:
            value = value * choose.uniform(0.0, 3.0)
        else:
            value = -value
        at(raw, tuple(above))[last] = value


def damage_structure(raw: dict, choose: random.Random) -> None:
    for _ in range(choose.choice([1, 1, 2, 3, 8])):
        found = list(places(raw))
        if not found:
            return
        *above, last = choose.choice(found)
        table, kind = at(raw, tuple(above)), choose.random()
        if kind < 0.25:
            del table[last]
        elif kind < 0.45:  # what stands elsewhere
            table[last] = copy.deepcopy(at(raw, choose.choice(found)))
        elif kind < 0.6:
            table[last] = choose.choice(TEXTS)
        elif kind < 0.7:
            table[last] = choose.choice(
                [
                    [],
                    {},
                    [[]],
                    [{}],
                    True,
                    None,
                    choose.choice(NUMBERS),
                    [choose.choice(NUMBERS)] * choose.choice([1, 2, 3, 50]),
                ]
            )
        elif isinstance(table, list):
            table.insert(choose.randrange(len(table) + 1), copy.deepcopy(choose.choice(table)))
        elif kind < 0.85:  # once more under another name
            table[choose.choice([f"{last}x", f"x{last}", *TEXTS])] = copy.deepcopy(table[last])
        else:  # a key of another table
            other = at(raw, choose.choice(found)[:-1])
            if isinstance(other, dict) and other:
                key = choose.choice(list(other))
                table[key] = copy.deepcopy(other[key])


def damage_bytes(data: bytes, choose: random.Random) -> bytes:
    data = bytearray(data)
    for _ in range(choose.choice([1, 1, 2, 4, 16])):
        place, kind = choose.randrange(len(data) + 1), choose.random()
        if kind < 0.35 and data:
            data[min(place, len(data) - 1)] = choose.choice([choose.randrange(256), choose.randrange(32, 127)])
        elif kind < 0.55:
            data[place:place] = choose.choice(FRAGMENTS)
        elif kind < 0.75:
            del data[place : place + choose.choice([1, 2, 10, 100])]
        elif kind < 0.9:
            end = place + choose.choice([2, 20, 200])
            data[place:place] = data[place:end] * choose.choice([1, 2, 30])
        else:
            data[place:place] = str(choose.choice(NUMBERS)).encode()
    return bytes(data)


def answer(number: int, seed: int, folder: Path) -> tuple[str, str]:
    """How a case ends, in a word, and its scene.  Anything but one of the project's errors is raised."""
    choose = random.Random(f"{seed} {number}")
    name = choose.choice(sorted(sources()))
    kind = choose.choice(["bytes", "structure", "numbers"])
    scene_text = ""
    try:
        if kind == "bytes":
            data = damage_bytes(sources()[name].encode(), choose)
            path, scene_text = folder / "damaged.toml", repr(data)
            path.write_bytes(data)
            scene = load_scene(path)
        else:
            raw = copy.deepcopy(joined(name))
            (damage_numbers if kind == "numbers" else damage_structure)(raw, choose)
            scene_text = repr(raw)
            scene = parse_scene(raw, "damaged.toml")
        model = build_model(scene)
        summary(model, scene.start)
    except TensegrityError as error:
        assert str(error).isprintable(), f"the message is not one line: {str(error)!r}"
        return f"{kind}: {type(error).__name__} of the scene", scene_text
    except Exception as failure:
        failure.add_note(f"case {number} of seed {seed}, {name}: {scene_text[:20000]}")
        raise
    try:
        result = simulate(model, held(model, grid(SIMULATED, STEP)), tolerance=1e-6)
    except TensegrityError as error:
        return f"{kind}: {type(error).__name__} of the run", scene_text
    assert np.isfinite(result.position).all() and np.isfinite(result.string_force).all(), "the results are not finite"
    return f"{kind}: simulated", scene_text


def judge(number: int, seed: int, folder: Path) -> tuple[str, str, str]:
    """(how it ends, what is wrong or nothing, the scene) of a case."""
    began, text = time.process_time(), ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            end, text = answer(number, seed, folder)
        wrong = ""
    except Exception as failure:
        end, wrong = f"{type(failure).__name__}", "".join(traceback.format_exception(failure))
    took = time.process_time() - began
    if not wrong and took > MOST_TIME:
        wrong = f"took {took:.1f} s of processor time ({end})\n{text[:20000]}"
    return end, wrong, text


def memory() -> float:
    """Bytes that the process has occupied at most; 0 where that cannot be asked."""
    try:
        import resource
    except ImportError:
        return 0.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1.0 if sys.platform == "darwin" else 1024.0)


def prepare(folder: Path) -> None:
    """Beside a damaged file stand all others, which it may extend."""
    for name, text in sources().items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", type=int, help="number of the one case to run")
    options = parser.parse_args()
    numbers = [options.only] if options.only is not None else range(options.first, options.first + options.cases)
    ends, failures, slowest, began = Counter(), 0, (0.0, -1), time.process_time()
    if hasattr(signal, "SIGVTALRM"):  # so that a case without end is named, too
        signal.signal(signal.SIGVTALRM, _too_long)
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for number in numbers:
            start = time.process_time()
            if hasattr(signal, "setitimer"):
                signal.setitimer(signal.ITIMER_VIRTUAL, 4.0 * MOST_TIME)
            end, wrong, text = judge(number, options.seed, Path(folder))
            if hasattr(signal, "setitimer"):
                signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
            ends[end] += 1
            slowest = max(slowest, (time.process_time() - start, number))
            if wrong or options.only is not None:
                failures += bool(wrong)
                print(f"--- case {number} of seed {options.seed}: {end}\n{wrong or text}", flush=True)
    for end, count in sorted(ends.items()):
        print(f"{count:7d}  {end}")
    print(
        f"{len(numbers)} cases in {time.process_time() - began:.0f} s of processor time, the slowest {slowest[0]:.2f} s "
        f"(case {slowest[1]}), {memory() / 1e6:.0f} MB at most, {failures} failures"
    )
    return 1 if failures or memory() > MOST_MEMORY else 0


def _too_long(*_):
    raise TimeoutError("no end in sight")


if __name__ == "__main__":
    sys.exit(main())
