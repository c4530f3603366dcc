"""The kernel with its assertions on (native/invariants.h): ``python -m tests.support.asserted [ARGUMENTS]`` compiles it, runs
the recorded scenes through it or, with arguments, pytest with these, and ends by a signal where something does not hold.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest

from tensegrity_core.kernel import binding
from tensegrity_core.native import build
from tensegrity_core.places import kept

OPTIONS = ("-O1", "-DTS_ASSERTIONS")
OBJECTS = kept() / "objects"


def use(library: Path) -> None:
    """From now on a kernel of no particular library is this one."""
    usual = binding.load_library
    binding.load_library = lambda path=None: usual(path or library)


def run_scenes() -> None:
    """The recorded scenes, by every method, shortly."""
    from tensegrity_core import kernel
    from tests.support import recorded

    def shortly(model, folder):
        yield "curves", recorded.or_refusal(recorded.curves, model)
        for method in recorded.METHODS:
            options = {"method": method} | recorded.OPTIONS.get(method, {})
            yield method, recorded.or_refusal(recorded.trajectory, kernel.simulate, model, 0.5, **options)
            yield f"inside {method}", recorded.or_refusal(recorded.inside, model, **options)

    recorded.groups = shortly
    for scene, _, group, record in recorded.recorded():
        print(scene, group, "refused" if "refused" in record else f"{len(record)} entries", flush=True)


def main(arguments: list[str]) -> int:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        use(build.compile_library(Path(folder), options=OPTIONS, objects=OBJECTS))
        if arguments:
            return pytest.main(["-q", "-n", "0", "--no-cov", "-p", "no:cacheprovider", *arguments])
        run_scenes()
    return 0


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):  # other words are pytest's
        sys.exit(print(__doc__))
    sys.exit(main(sys.argv[1:]))
