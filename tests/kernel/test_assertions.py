"""The kernel with its assertions on (native/invariants.h): nothing that it does in scenes and tests breaks them, and what does
is found."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tensegrity_core.native import build
from tests.support.asserted import OBJECTS, OPTIONS

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process that is ended by abort() shows a dialogue there")


def asserted(*arguments: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "tests.support.asserted", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", timeout=600)


def test_the_recorded_scenes_keep_the_assertions():
    done = asserted()
    assert done.returncode == 0 and "does not hold" not in done.stderr, done.stderr[-2000:]
    assert len(done.stdout.splitlines()) > 100 and done.stdout.count("refused") < 5, done.stdout


def test_the_kernel_s_tests_keep_the_assertions():
    files = (f"tests/kernel/test_{name}.py" for name in ("kernel", "kernel_drives", "moving_inputs"))
    done = asserted(*files, "-s", "-k", "not table and not 50_s and not ledger and not reference and not fmu")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


@pytest.mark.parametrize(
    "file, there, wrong",
    [
        ("laws/curve.c", "i + 1 < c->pieces ? i + 1 : -1", "i + 2"),
        ("motion/motion.c", "c[d] *= factor;", "c[d] *= 1.00001 * factor;"),
        ("model/packed.c", "5 * E * D", "(a->base ? 5 : 9) * (E * D + 1)"),
    ],
)
def test_what_breaks_an_assertion_is_found(tmp_path, monkeypatch, file, there, wrong):
    """In a copy of the sources that is wrong at one place."""
    copy = tmp_path / "native"
    shutil.copytree(build.HERE, copy, ignore=shutil.ignore_patterns("*.so", "*.dylib", "__pycache__"))
    text = (copy / file).read_text(encoding="utf-8")
    assert text.count(there) == 1, f"{file} has not one {there!r}"
    (copy / file).write_text(text.replace(there, wrong), encoding="utf-8")
    monkeypatch.setattr(build, "HERE", copy)
    library = build.compile_library(tmp_path, options=OPTIONS, objects=OBJECTS)
    program = (
        "import sys\nfrom pathlib import Path\nfrom tensegrity_core.kernel import Kernel\n"
        "from tensegrity_core.scene import load_scene\nfrom tensegrity_core.statics import build_model\n"
        "kernel = Kernel(build_model(load_scene('two_bar_nsh')), library=Path(sys.argv[1]))\n"
        "kernel['force'][1] = 100.0\nkernel.initialize()\nfor _ in range(100):\n    kernel.step(0.02)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(library)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode < 0 and f"{Path(file).name}:" in done.stderr and "does not hold" in done.stderr, done.stderr
