"""The pages as a newcomer follows them, word for word, with the wheel and nothing else: ``python -m tests.support.quick_start``

For every Python that is named: a fresh environment with the wheel; then every block of every page, in order, in one folder a
page that is called `ü #1`.  On PATH stand the environment's programs only, so that there is no compiler; HOME is another
folder, which is read-only; there is no network.  The last two by namespaces of Linux (`unshare`), without which this ends with
an error.  Blocks that are marked `<!-- setup -->`, and those that run benchmarks or tests, are for a clone: they are left out,
and counted.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tensegrity_core.native import wheels

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^(?P<setup><!-- setup -->\n)?```(?P<language>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
#: What a clone has and a wheel has not.
CLONE = re.compile(r"^python (-m (benchmarks|tests)\.|build_fmu\.py|docs/)", re.MULTILINE)
#: Languages of blocks that are followed; the others are there to be read.
FOLLOWED = {"sh", "python", "toml"}
#: $1 read-only, and the rest of the words as a command; there is no network in here.
INSIDE = 'home=$1; shift; mount --bind "$home" "$home" && mount -o remount,ro,bind "$home" && exec "$@"'
#: What must fail in there, else this proves nothing.
GUARDS = {
    "the home folder can be written to": "open(__import__('os').environ['HOME'] + '/x', 'w')",
    "there is a network": "import socket; socket.create_connection(('pypi.org', 443), 5)",
    "a compiler is found": "import shutil; assert any(map(shutil.which, ('cc', 'gcc', 'clang', 'zig', 'node')))",
    "the clone is found": f"import tensegrity_core; assert tensegrity_core.__file__.startswith({str(ROOT) + os.sep!r})",
}


def pages() -> list[Path]:
    return sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])


def blocks(page: Path) -> tuple[list[tuple[str, str]], int]:
    """Language and text of the blocks that are to be followed, and how many are not."""
    found = [block for block in BLOCK.finditer(page.read_text(encoding="utf-8")) if block["language"] in FOLLOWED]
    followed = [(block["language"], block["text"]) for block in found if not (block["setup"] or CLONE.search(block["text"]))]
    return followed, len(found) - len(followed)


class Newcomer:
    """An environment of a Python with the wheel, in a folder."""

    def __init__(self, python: str, wheel: Path, folder: Path):
        self.home, self.programs = folder / "home", folder / "venv" / "bin"
        self.home.mkdir(parents=True)
        self.settings = {"HOME": str(self.home), "PATH": str(self.programs), "LANG": "C.UTF-8"}
        subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
        subprocess.run([self.programs / "python", "-m", "pip", "install", "--quiet", wheel], check=True)

    def run(self, words: list, folder: Path) -> subprocess.CompletedProcess:
        command = ["unshare", "--mount", "--net", "sh", "-c", INSIDE, "sh", self.home, "env", "-i"]
        command += [f"{name}={value}" for name, value in self.settings.items()]
        return subprocess.run(
            [*map(str, command), *map(str, words)], cwd=folder, capture_output=True, text=True, encoding="utf-8"
        )

    def guarded(self, folder: Path) -> None:
        """Raises RuntimeError where the surroundings are not those of a newcomer."""
        done = self.run([self.programs / "python", "-c", "import tensegrity_core"], folder)
        if done.returncode:
            raise RuntimeError(f"the environment does not work: {done.stderr}")
        for what, code in GUARDS.items():
            if not self.run([self.programs / "python", "-c", code], folder).returncode:
                raise RuntimeError(f"{what}: this would prove nothing")

    def follow(self, page: Path, folder: Path) -> str:
        """Returns what went wrong, or ''."""
        for language, text in blocks(page)[0]:
            if language == "toml":
                (folder / re.match(r"# (\S+)", text)[1]).write_text(text, encoding="utf-8")  # type: ignore[index]
                continue
            words = {"sh": ["/bin/sh", "-ec", text], "python": [self.programs / "python", "-c", text]}[language]
            done = self.run(words, folder)
            if done.returncode:
                return f"{text}\nexit code {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        return ""


def main(words: list[str] | None = None) -> int:
    """Returns the exit code: 0, or 1 where a block failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.quick_start", description=__doc__.splitlines()[0])
    parser.add_argument("--pythons", nargs="+", default=[sys.executable], metavar="FILE", help="default: this one")
    parser.add_argument("--wheel", type=Path, metavar="FILE", help="default: one is built")
    parser.add_argument("--pages", nargs="+", type=Path, default=pages(), metavar="FILE", help="default: README.md and docs/")
    options = parser.parse_args(words)
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = options.wheel or wheels.build_wheel("linux64", folder)
        for i, python in enumerate(options.pythons):
            newcomer = Newcomer(python, wheel.resolve(), folder / str(i))
            newcomer.guarded(folder)
            for page in options.pages:
                place = folder / str(i) / page.stem / "ü #1"
                place.mkdir(parents=True)
                begin = time.monotonic()
                wrong = newcomer.follow(page, place)
                followed, left_out = blocks(page)
                told = f"{len(followed)} blocks, {left_out} for a clone, {time.monotonic() - begin:.0f} s"
                if followed:
                    print(f"{python}: {page.name}: {told}: {'FAILED' if wrong else 'as it says'}\n{wrong}".rstrip(), flush=True)
                failed += bool(wrong)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
