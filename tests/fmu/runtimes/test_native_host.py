"""The native FMU in a plain C host (native_host.c): threads, cycles, memory checkers, two FMUs in one process, a comma locale.

The full counts of cycles and random calls take some minutes:
``NATIVE_HOST_FULL=1 pytest -n 0 tests/fmu/runtimes/test_native_host.py``.
"""

import os
import shutil
import subprocess
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from fmu_src.packing.native_fmu import pack_native_fmu, variables_bin
from fmu_src.variables.interface import variables
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.native import build
from tests.conftest import once
from tests.support import scene
from tests.support.native_calls import described, library_of

HERE = Path(__file__).parent
FULL = bool(os.environ.get("NATIVE_HOST_FULL"))
CYCLES = {"two_bar": 20_000, "two_bar_nsh": 10_000 if FULL else 100}  # an NSH's force curves take 10 ms to compute
CALLS = 200_000 if FULL else 12_000
STEPS, PUSH = 200, 45.0  # of native_host.c
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g1", "-O1"]

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the host is written for POSIX")


def compiled(folder: Path, name: str, options: list[str], sources: tuple[Path, ...] | list[Path] = ()) -> Path:
    """The host as a program; skips where there is no compiler."""
    command = build.system_compiler()
    if command is None:
        pytest.skip("no C compiler: the plain C host is not run")
    target = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    includes = [f"-I{build.fmi_headers()}", f"-I{build.HERE}"]
    files = [str(HERE / "native_host.c"), *map(str, sources)]
    done = subprocess.run(
        [*command, *options, *includes, *files, "-ldl", "-lpthread", "-lm", "-o", str(target)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture(scope="session")
def host(tmp_path_factory):
    """The program that loads the FMU's library."""
    return once(tmp_path_factory, "native_host", lambda folder: compiled(folder, "host", [*WARNINGS, "-O2"])) / "host"


def watched_build(tmp_path_factory) -> Path:
    """A folder with host, runtime and kernel compiled with AddressSanitizer and UndefinedBehaviorSanitizer: the program `host`,
    and the FMU's library `native.so`; made once.  Skips where there is no such compiler."""
    sources = [*build.runtime_sources(), *build.kernel_sources()]

    def make(folder):
        folder.mkdir(parents=True)
        command = [*(build.system_compiler() or ["cc"]), "-std=c99", *SANITIZERS]
        probe = [*command, "-x", "c", "-", "-o", os.devnull]
        if build.system_compiler() is None:
            return
        if subprocess.run(probe, input="int main(void) { return 0; }", capture_output=True, text=True).returncode:
            return
        includes = [f"-I{build.fmi_headers()}", f"-I{build.HERE}"]
        options = ["-fPIC", "-fvisibility=hidden", *includes, "-c", *map(str, sources)]
        subprocess.run([*command, *options], check=True, cwd=folder)
        objects = sorted(folder.glob("*.o"))
        shared = ["-shared", *map(str, objects), "-lm", "-o", "native.so"]
        subprocess.run([*command, *shared], check=True, cwd=folder)
        compiled(folder, "host", ["-std=c99", *SANITIZERS, "-DLINKED"], objects)

    folder = once(tmp_path_factory, "native_sanitized", make)
    if not (folder / "host").exists():
        pytest.skip("no C compiler with AddressSanitizer and UndefinedBehaviorSanitizer")
    return folder


@pytest.fixture(scope="session")
def sanitized(tmp_path_factory):
    """Host, runtime and kernel in one program that watches itself."""
    return watched_build(tmp_path_factory) / "host"


@pytest.fixture(scope="session")
def counting(tmp_path_factory):
    """The program that loads the FMU's library, with its own malloc, calloc, realloc and free, which count."""
    probe = "extern void *__libc_malloc(unsigned long); int main(void) { return !__libc_malloc(1); }"
    compiler = build.system_compiler()
    if compiler is None:
        pytest.skip("no C compiler: the plain C host is not run")
    line = [*compiler, "-x", "c", "-", "-o", os.devnull]
    if subprocess.run(line, input=probe, capture_output=True, text=True).returncode:
        pytest.skip("only the GNU C library lets a program count its allocations this way")
    options = [*WARNINGS, "-O2", "-DCOUNTED"]
    return once(tmp_path_factory, "native_counting", lambda folder: compiled(folder, "host", options)) / "host"


def arguments(folder: Path) -> list[str]:
    """What the host must know of an extracted FMU; it reads no XML."""
    found = described(folder)
    reals = [v for v in found.modelVariables if v.type == "Real"]
    inputs = [v for v in reals if v.causality == "input"]
    first = min(v.valueReference for v in reals if v.causality == "output")
    pushed = next(v.valueReference for v in inputs if v.name.endswith("force.z"))
    library, resources = library_of(folder), (folder / "resources").as_uri()
    return [str(library), found.guid, resources, *map(str, (len(inputs), first, len(reals), pushed))]


def run(program: Path, folder: Path, *command, before=(), environment=(), timeout=600, **options) -> str:
    """What the host prints; it must end well."""
    line = [*before, str(program), *arguments(folder), *map(str, command)]
    done = subprocess.run(
        line, capture_output=True, text=True, timeout=timeout, env={**os.environ, **dict(environment)}, **options
    )
    assert done.returncode == 0, f"{done.stdout[-1000:]}\n{done.stderr[-4000:]}"
    return done.stdout


def kernel_rows(name: str) -> np.ndarray:
    """(STEPS, outputs) of the host's run, by the kernel."""
    model = scene(name)
    kernel = Kernel(model)
    pushed = next(row.reference for row in variables(model) if row.name.endswith("force.z"))
    kernel.initialize()
    rows = []
    for k in range(STEPS):
        kernel.values[pushed] = -PUSH if k // 50 % 2 else PUSH
        kernel.step(1e-3)
        rows.append(kernel.values[kernel.layout["position"].start :].copy())
    return np.array(rows)


SCENES = ("two_bar", "three_bar_nsh", "six_bar_nsh")


@pytest.mark.parametrize("name", SCENES)
def test_a_c_host_gets_the_kernels_results(name, host, native_folders, tmp_path):
    run(host, native_folders[name], "run", STEPS, tmp_path / "rows")
    expected = kernel_rows(name)
    found = np.fromfile(tmp_path / "rows").reshape(expected.shape)
    assert np.max(np.abs(found - expected) / np.maximum(np.max(np.abs(expected), axis=0), 1e-300)) <= 1e-12


@pytest.mark.parametrize("name", SCENES)
def test_every_function_from_a_c_host(name, host, native_folders):
    run(host, native_folders[name], "everything")


@pytest.mark.parametrize("name", SCENES)
def test_rollback_from_a_c_host(name, host, native_folders):
    run(host, native_folders[name], "rollback")


def test_eight_instances_in_eight_threads(host, native_folders):
    for name in SCENES:
        run(host, native_folders[name], "threads", 8)


@pytest.mark.parametrize("name", CYCLES)
def test_memory_stays_flat(name, host, native_folders):
    """Instantiate, step and free again and again: what is resident does not grow with the cycles.

    It goes up by pages and now and then by many at once, so the growth is the median over the nine later tenths: what a leak
    has in each of them.
    """
    resident = np.array(run(host, native_folders[name], "cycles", CYCLES[name]).split(), dtype=float)
    growth = 1024.0 * np.median(np.diff(resident)) / (CYCLES[name] / 10)
    assert len(resident) == 10 and growth < max(8.0, 4096.0 / (CYCLES[name] / 10)), f"{growth} bytes per cycle: {resident} kB"


@pytest.mark.parametrize("name", ["two_bar", "two_bar_nsh", "three_bar", "six_bar_nsh"])
def test_every_block_of_memory_is_freed(name, counting, native_folders):
    """Counted, not measured: as many blocks are held after each later tenth (the first print takes one for its buffer)."""
    blocks = [int(n) for n in run(counting, native_folders[name], "blocks", 100 if name == "two_bar" else 10).split()]
    assert len(blocks) == 10 and blocks[1] > 0 and set(blocks[1:]) == {blocks[1]}


@pytest.mark.parametrize("seed", range(10 if FULL else 3))
@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar"])
def test_random_calls_from_a_c_host(name, seed, host, native_folders):
    """Never worse than fmi2Error, and after a reset the run of a fresh instance; most kinds of answers are met."""
    seen = [int(n) for n in run(host, native_folders[name], "walk", seed, CALLS).split()]
    assert min(seen) > 0 and seen[-1] > CALLS / 20


# Memory checkers


def valgrind():
    if shutil.which("valgrind") is None:
        pytest.skip("valgrind is not installed (Debian: apt-get install valgrind)")
    return [
        "valgrind",
        "--quiet",
        "--leak-check=full",
        "--show-leak-kinds=all",
        "--errors-for-leak-kinds=all",
        "--error-exitcode=9",
    ]


@pytest.mark.parametrize("command", [("everything",), ("walk", 5, 20_000 if FULL else 400), ("cycles", 10)])
def test_clean_under_valgrind(command, host, native_folders):
    run(host, native_folders["two_bar_nsh"], *command, before=valgrind())


def test_threads_are_clean_under_helgrind(host, native_folders):
    """No data race between instances; the full count only, it takes long."""
    if not FULL:
        pytest.skip("slow: set NATIVE_HOST_FULL=1")
    run(
        host,
        native_folders["two_bar_nsh"],
        "threads",
        8,
        before=[valgrind()[0], "--tool=helgrind", "--quiet", "--error-exitcode=9"],
    )


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar"])
@pytest.mark.parametrize("command", [("everything",), ("rollback",), ("threads", 8), ("cycles", 20)])
def test_clean_under_sanitizers(command, name, sanitized, native_folders):
    run(sanitized, native_folders[name], *command)


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar", "six_bar_nsh"])
def test_random_calls_are_clean_under_sanitizers(name, sanitized, native_folders):
    run(sanitized, native_folders[name], "walk", 11, CALLS // 4)


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar"])
def test_hostile_values_are_clean_under_sanitizers(name, sanitized, native_folders):
    """Every variable set to each of many values, before the start and between steps: a part of the cases, or all."""
    stride = 1 if FULL else 149 if name == "three_bar" else 997
    found = [int(n) for n in run(sanitized, native_folders[name], "setters", 1e-6, 5 if stride > 1 else 0, stride).split()]
    assert found[0] > 5 and found[2] > 2 and found[3] == 0


@pytest.mark.parametrize("name", ["two_bar", "three_bar"])
def test_forged_states_are_clean_under_sanitizers(name, sanitized, native_folders):
    """States with foreign pieces under right checksums: refused, or an instance that works and stays in bounds."""
    found = [int(n) for n in run(sanitized, native_folders[name], "states", 3, 5000 if FULL else 300).split()]
    assert found[0] > 100 and found[2] + found[3] > 50


@pytest.mark.parametrize("method", range(1, 6))
def test_every_method_is_clean_under_sanitizers(method, sanitized, native_folders, tmp_path):
    """An FMU whose model starts with the method."""
    copy, model = tmp_path / "copy", scene("two_bar_nsh")
    shutil.copytree(native_folders["two_bar_nsh"], copy)
    packed = to_bytes(model, method=METHODS[method])
    (copy / "resources" / "model.bin").write_bytes(packed)
    (copy / "resources" / "variables.bin").write_bytes(variables_bin(model, variables(model), described(copy).guid, packed))
    for command in (("rollback",), ("threads", 2), ("cycles", 10)):
        run(sanitized, copy, *command)


def test_damaged_files_are_clean_under_sanitizers(sanitized, native_folders, tmp_path):
    """Serialised states and resources cut anywhere: refused, and nothing is read beyond their ends."""
    folder, state = native_folders["two_bar_nsh"], tmp_path / "state"
    run(sanitized, folder, "state", "WRITE", state)
    good = state.read_bytes()
    assert run(sanitized, folder, "state", "READ", state).strip() == "0"
    for bad in (b"", good[:71], good[:72], good[: len(good) // 2], good[:-1], good + b"x", bytes(len(good))):
        state.write_bytes(bad)
        assert run(sanitized, folder, "state", "READ", state).strip() == "2"


@pytest.mark.parametrize("file", ["variables.bin", "model.bin"])
def test_cut_resources_are_clean_under_sanitizers(file, sanitized, native_folders, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(native_folders["two_bar_nsh"], copy)
    path = copy / "resources" / file
    good = path.read_bytes()
    rng = np.random.default_rng(7)
    for size in (0, 1, 8, 23, 24, *rng.integers(25, len(good), 12).tolist(), None):
        if size is None:
            path.unlink()
            path.mkdir()  # a folder in the file's place
        else:
            path.write_bytes(good[:size])
        line = [str(sanitized), *arguments(copy), "everything"]
        done = subprocess.run(line, capture_output=True, text=True)
        assert done.returncode == 1 and "fmi2Instantiate: does not hold" in done.stderr, (size, done.stderr[-2000:])


# Several FMUs, locale, allocations


@pytest.mark.parametrize("names", [("two_bar", "six_bar_nsh"), ("six_bar_nsh", "two_bar")])
def test_two_fmus_loaded_globally_do_not_disturb_each_other(names, host, native_folders, tmp_path):
    files = [tmp_path / name for name in names]
    first, second = (native_folders[name] for name in names)
    run(host, first, "two", *files, *arguments(second))
    for name, file in zip(names, files):
        run(host, native_folders[name], "run", STEPS, tmp_path / "alone")
        assert file.read_bytes() == (tmp_path / "alone").read_bytes()


def comma_locale(folder: Path) -> dict[str, str]:
    """Environment in which the locale xx_XX has a decimal comma; made by localedef, so that none need be installed."""
    if shutil.which("localedef") is None:
        pytest.skip("localedef is missing: no locale with a decimal comma can be made")
    source = folder / "comma"
    lines = (
        "comment_char %",
        "escape_char /",
        "LC_NUMERIC",
        'decimal_point ","',
        'thousands_sep ""',
        "grouping -1",
        "END LC_NUMERIC",
    )
    source.write_text("\n".join(lines) + "\n", encoding="utf-8")
    subprocess.run(["localedef", "-c", "-i", str(source), "-f", "ANSI_X3.4-1968", str(folder / "xx_XX")], capture_output=True)
    if not (folder / "xx_XX" / "LC_NUMERIC").exists():
        pytest.skip("localedef could not make a locale with a decimal comma")
    return {"LOCPATH": str(folder)}


def test_numbers_keep_their_point_under_a_comma_locale(host, native_folders, tmp_path):
    text = run(host, native_folders["three_bar_nsh"], "messages", "xx_XX", environment=comma_locale(tmp_path))
    assert "the tolerance 0.75 is out of range" in text
    assert "s1.rest_length = -0.25 refused, 1.1668" in text and "at least 0" in text
    assert "the communication point is 0.125 s, but the FMU stands at 0.7 s" in text
    times = [line.split("t = ")[1] for line in text.splitlines() if " logEvents " in line]
    assert times and all(time.startswith("0.") for time in times)
    assert "," not in text.replace(", ", "")


@pytest.mark.parametrize("name", SCENES)
def test_steps_take_no_memory(name, counting, native_folders):
    """malloc, calloc and realloc are counted over a run with all messages on."""
    count, messages = map(int, run(counting, native_folders[name], "allocations").split())
    assert count == 0 and messages > 0


@pytest.mark.parametrize("method", [m for m in METHODS if m != "rk4"])  # rk4 is unstable there
def test_an_instance_takes_little_stack(method, host, native_folders):
    """From instantiation to its end, with all messages, on a stack that is painted before: docs/fmu.md says 16 kB."""
    used = int(run(host, native_folders["six_bar_nsh"], "stack", list(METHODS).index(method)))
    assert 500 < used < 16_384


def test_a_packed_fmu_runs_in_a_c_host_from_an_odd_folder(host, tmp_path):
    odd = tmp_path / "größe #1"
    with ZipFile(pack_native_fmu(scene("two_bar"), tmp_path / "two_bar.fmu")) as archive:
        archive.extractall(odd)
    run(host, odd, "rollback")


def test_sources_compile_without_a_warning(tmp_path):
    """The runtime's and the kernel's sources as C99, for real-time targets' compilers."""
    command = build.system_compiler()
    if command is None:
        pytest.skip("no C compiler")
    for path in (*build.runtime_sources(), *build.kernel_sources()):
        line = [*command, *WARNINGS, "-fsyntax-only", f"-I{build.fmi_headers()}", f"-I{build.HERE}", str(path)]
        done = subprocess.run(line, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
