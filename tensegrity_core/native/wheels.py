"""Wheels for all platforms, out of a clone or an unpacked source archive: python -m tensegrity_core.native.wheels

``ziglang`` compiles the libraries for each of them, for this one as well: against the oldest C library that will do.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

from .. import __version__
from ..progress import Bar, each, expected
from . import build

ROOT = Path(__file__).resolve().parents[2]
#: That a wheel takes, about.
SECONDS = 40.0
NEEDED = ("hatchling", "ziglang", "fmpy")


def build_wheel(platform: str, folder: Path) -> Path:
    """The wheel for a platform, a key of build.TARGETS, into a folder.  Raises RuntimeError with the builder's words."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder.resolve())]
    surroundings = os.environ | {build.WHEEL_FOR: platform}
    run = subprocess.run(command, cwd=ROOT, env=surroundings, capture_output=True, text=True, errors="replace")
    if run.returncode:
        raise RuntimeError(f"the wheel for {platform} could not be built:\n{run.stdout}{run.stderr}")
    return folder / f"tensegrity_fmu-{__version__}-py3-none-{build.TARGETS[platform].tag}.whl"


def main(words: list[str] | None = None) -> int:
    """Returns the exit code: 0, or 2 where a wheel could not be built."""
    parser = argparse.ArgumentParser(prog="python -m tensegrity_core.native.wheels", description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("dist/wheels"), metavar="DIR", help="default: %(default)s")
    parser.add_argument("--platforms", nargs="+", choices=build.TARGETS, default=list(build.TARGETS), help="default: all")
    options = parser.parse_args(words)
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing or not (ROOT / "pyproject.toml").is_file():
        problem = f"{', '.join(missing)} is missing" if missing else f"{ROOT} is no source tree"
        print(f'{problem}; in a clone: pip install -e ".[cross]"', file=sys.stderr)
        return 2
    options.output.mkdir(parents=True, exist_ok=True)
    try:
        with Bar("wheels") as bar:
            for platform, told in each(options.platforms, bar):
                bar.what = f"wheel for {platform}"
                with expected(SECONDS, told):
                    wheel = build_wheel(platform, options.output)
                bar.print(f"wrote {wheel}")
    except RuntimeError as failure:
        print(failure, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
