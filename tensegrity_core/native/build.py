"""Compile the C sources: the kernel into a shared library beside this file, kernel and FMI functions into the library of the
native FMU, and the library of the Python FMU.  Called by the build of the package (pyproject.toml), and to build FMUs for
other platforms.

The system's C compiler is used where there is one, else the one in the ``ziglang`` package, which the build then asks for.
The FMI headers are those of the installed fmpy.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import platform as machine
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import types
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ModuleNotFoundError:  # outside of a build of the package
    BuildHookInterface = object  # type: ignore[assignment, misc]

HERE = Path(__file__).resolve().parent
RUNTIME = HERE.parent.parent / "fmu_src" / "native_runtime"
PYTHON_RUNTIME = HERE.parent.parent / "fmu_src" / "python_runtime"
LIBRARY = {"win32": "tensegrity.dll", "darwin": "libtensegrity.dylib"}.get(sys.platform, "libtensegrity.so")
FMU_LIBRARY = "tensegrity_fmu" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
PYTHON_LIBRARY = FMU_LIBRARY.replace("_fmu", "_python")
#: Order of the folders of the kernel's sources: a file includes files of its own order and of later ones.  The last holds what
#: a host sees, and what all share: the public header, the list of fields, the list of errors.
ORDERS = {
    "interface": 1,
    "steps": 2,
    "methods": 3,
    "motion": 4,
    "laws": 5,
    "laws/memory": 5,
    "model": 6,
    "linear": 7,
    ".": 8,
}
#: Suffixes of files that the compiler reads.
SOURCES = {".c", ".h", ".def"}
#: Runs on any processor of the platform's baseline; contraction off, so that platforms agree to the last digits.
FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fvisibility=hidden"]


class Target(NamedTuple):
    """A platform of FMUs and wheels.  suffix: of its libraries; triple: zig's name, with the oldest C library or system that
    will do; tag: the wheel's name for the same."""

    suffix: str
    triple: str
    tag: str


#: By FMI's name of the platform.
TARGETS = {
    "linux64": Target(".so", "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64"),
    "win64": Target(".dll", "x86_64-windows-gnu", "win_amd64"),
    "darwin64": Target(".dylib", "x86_64-macos.11.0", "macosx_11_0_x86_64"),
    "aarch64-linux": Target(".so", "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64"),
    "aarch64-darwin": Target(".dylib", "aarch64-macos.11.0", "macosx_11_0_arm64"),
}
#: Names a key of TARGETS for which the wheel is built; unset: for this platform.  See wheels.py.
WHEEL_FOR = "TENSEGRITY_WHEEL_FOR"

#: FMI's name of the platform by (sys.platform, machine).
HOSTS = {
    ("linux", "x86_64"): "linux64",
    ("linux", "aarch64"): "aarch64-linux",
    ("win32", "amd64"): "win64",
    ("darwin", "x86_64"): "darwin64",
    ("darwin", "arm64"): "aarch64-darwin",
}

#: Of the kernel for web pages: what a page calls (output/page/web/kernel.js), and how it is compiled, with vectors for pairs.
WEB_CALLS = """create free counts values integers real_count integer_count time message concerned status_name reset check
    initialize step output_first transition_count transition_stored transitions stats state_size save restore""".split()
WEB_FLAGS = ["-target", "wasm32-wasi", "-mexec-model=reactor", "-msimd128"]


def system_compiler() -> list[str] | None:
    """Command of a GCC-like compiler: CC if it is set, else the first found; None where there is none."""
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    return None


def zig(platform: str | None = None) -> list[str]:
    """Command of the compiler in the ``ziglang`` package; platform: a key of TARGETS, or None for this one.

    The target is named for this platform, too: else zig compiles for the very processor that it runs on, and asks the system's
    compiler, which may be missing, where the C library is.
    """
    if platform is None:
        platform = HOSTS.get((sys.platform, machine.machine().lower()))
        if sys.platform == "linux" and machine.libc_ver()[0] != "glibc":
            platform = None
    target = ["-target", TARGETS[platform].triple] if platform else ["-mcpu=baseline"]
    return [sys.executable, "-m", "ziglang", "cc", *target]


def kernel_sources() -> list[Path]:
    """They include each other by paths below HERE, so that folder must be among the compiler's."""
    return [path for room in ORDERS for path in sorted((HERE / room).glob("*.c"))]


def runtime_sources() -> list[Path]:
    return sorted(RUNTIME.glob("*.c"))


def python_runtime_sources() -> list[Path]:
    """Of the Python FMU's library; it reads the resources as the native one does."""
    return [*sorted(PYTHON_RUNTIME.glob("*.c")), RUNTIME / "resources.c"]


def reads(kind: str) -> list[Path]:
    """Files that determine a library, 'kernel', 'native' or 'python': sources, and how they are compiled."""
    rooms = [HERE / room for room in ORDERS]
    folders = {"kernel": rooms, "native": [*rooms, RUNTIME], "python": [PYTHON_RUNTIME]}[kind]
    found = [path for folder in folders for path in sorted(folder.iterdir()) if path.suffix in SOURCES]
    if kind == "python":
        found += sorted(RUNTIME.glob("resources.*"))
    return [*found, HERE / Path(__file__).name]


def file_name(kind: str, platform: str | None = None) -> str:
    """Of a library; platform: a key of TARGETS, or None for this one."""
    if platform is None:
        return {"kernel": LIBRARY, "native": FMU_LIBRARY, "python": PYTHON_LIBRARY}[kind]
    suffix = TARGETS[platform].suffix
    if kind == "kernel":
        return f"{'' if suffix == '.dll' else 'lib'}tensegrity{suffix}"
    return f"tensegrity_{'fmu' if kind == 'native' else 'python'}{suffix}"


def fmi_headers() -> Path:
    """Folder of the FMI headers.  Raises RuntimeError where fmpy is missing."""
    found = importlib.util.find_spec("fmpy")
    if found is None or not found.origin:
        raise RuntimeError("the FMI headers come with fmpy, which is not installed: pip install fmpy")
    return Path(found.origin).parent / "c-code"


class Part(NamedTuple):
    """Sources that are compiled alike.  options: of the compiler; folders: where it looks for headers."""

    sources: list[Path]
    options: list[str]
    folders: list[Path]

    def compiled(self, command: list[str], folder: Path) -> list[Path]:
        """Object files in a folder, each under a name that stands for all that determines it: what is there is taken."""
        headers = [path for place in self.folders for path in sorted(place.rglob("*")) if path.suffix in SOURCES - {".c"}]
        asked = command[: command.index("-target")] if "-target" in command else command  # for macOS zig would leave a file
        version = subprocess.run([*asked, "--version"], capture_output=True).stdout
        common = [" ".join([*command, *self.options]).encode(), version, *(path.read_bytes() for path in headers)]
        line = [*command, *self.options, *(f"-I{place}" for place in self.folders)]

        def made(source: Path) -> Path:
            digest = hashlib.sha256(b"\0".join([source.name.encode(), source.read_bytes(), *common])).hexdigest()[:16]
            target = folder / f"{source.stem}-{digest}.o"
            return target if target.is_file() else _whole(target, [*line, "-c", str(source)])

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return list(pool.map(made, self.sources))


def _kernel(options: list[str], exported: bool) -> list[Part]:
    """The kernel; exported: others may call it, which its interface alone has to know."""
    inner = [path for path in kernel_sources() if path.parent.name != "interface"]
    interface = [path for path in kernel_sources() if path.parent.name == "interface"]
    return [Part(inner, options, [HERE]), Part(interface, options + ["-DTS_EXPORTED"] * exported, [HERE])]


def _linked(
    target: Path, command: list[str], parts: list[Part], options: list[str], windows: bool, objects: Path | None
) -> Path:
    """The parts as one library.  options: of the linker; objects: folder in which object files are found and left, or None."""
    libraries = [] if windows else ["-lm", "-ldl"]  # until glibc 2.34 dlopen is in a library of its own
    with tempfile.TemporaryDirectory() as scratch:
        files = [path for part in parts for path in part.compiled(command, objects or Path(scratch))]
        return _whole(target, [*command, "-shared", *options, *map(str, files), *libraries])


def _whole(target: Path, command: list[str]) -> Path:
    """Run a compiler whose file appears whole or not at all, and is the same whenever it is made: else libraries for Windows
    hold the time.  Raises RuntimeError with the compiler's words."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        fresh = Path(scratch) / target.name
        line, surroundings = [*command, "-o", str(fresh)], {"SOURCE_DATE_EPOCH": "0", **os.environ}
        run = subprocess.run(line, capture_output=True, text=True, errors="replace", env=surroundings)  # it names paths: bytes
        if run.returncode:
            raise RuntimeError(f"compiling {target.name} failed; command: {' '.join(line)}\n{run.stderr}")
        os.replace(fresh, target)
    return target


def _flags(windows: bool) -> list[str]:
    return [*FLAGS, *([] if windows else ["-fPIC"])]


def compile_library(
    directory: Path, command: list[str] | None = None, options: tuple[str, ...] = (), objects: Path | None = None
) -> Path:
    """The kernel for this platform, into a folder; options: of the compiler, they come after FLAGS; objects: see _linked."""
    command, windows = command or system_compiler() or zig(), sys.platform == "win32"
    parts = _kernel([*_flags(windows), *options], exported=True)
    return _linked(directory / LIBRARY, command, parts, list(options), windows, objects)


def _compile_for(platform: str | None, target: Path, parts: Callable[[list[str]], list[Part]], objects: Path | None) -> Path:
    """platform: a key of TARGETS, then zig compiles for it, or None for this platform; parts: by the options of the compiler;
    objects: see _linked."""
    command, windows, darwin = system_compiler() or zig(), sys.platform == "win32", sys.platform == "darwin"
    if platform is not None:
        command = zig(platform)
        windows, darwin = platform.startswith("win"), "darwin" in platform
    options = ["-s"]
    if platform and darwin:  # else the folder of this compilation is written into the library
        options.append(f"-Wl,-install_name,@rpath/{target.name}")
    return _linked(target, command, parts(_flags(windows)), options, windows, objects)


def compile_fmu_library(target: Path, platform: str | None = None, objects: Path | None = None) -> Path:
    """The native FMU's library; platform, objects: see _compile_for."""

    def parts(options: list[str]) -> list[Part]:
        runtime = Part(runtime_sources(), options, [fmi_headers(), HERE, RUNTIME])
        return [runtime, *_kernel(options, exported=False)]

    return _compile_for(platform, target, parts, objects)


def compile_python_library(target: Path, platform: str | None = None, objects: Path | None = None) -> Path:
    """The Python FMU's library; platform, objects: see _compile_for."""

    def parts(options: list[str]) -> list[Part]:
        return [Part(python_runtime_sources(), options, [fmi_headers(), RUNTIME, PYTHON_RUNTIME])]

    return _compile_for(platform, target, parts, objects)


def compile_kernel(target: Path, platform: str | None = None, objects: Path | None = None) -> Path:
    """The kernel for the Python FMU; platform, objects: see _compile_for."""
    return _compile_for(platform, target, lambda options: _kernel(options, exported=True), objects)


def compile_web_kernel(target: Path) -> Path:
    """The kernel as a WebAssembly module that imports nothing, by zig, into this file.  Raises RuntimeError."""
    exports = [f"-Wl,--export={name}" for name in ("malloc", *(f"ts_{call}" for call in WEB_CALLS))]
    command = [sys.executable, "-m", "ziglang", "cc", *WEB_FLAGS, *FLAGS, "-s", f"-I{HERE}"]
    return _whole(target, [*command, *map(str, kernel_sources()), *exports])


class KernelHook(BuildHookInterface):
    """Builds the libraries for wheels and editable installs alike."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        needs_zig = os.environ.get(WHEEL_FOR) or not system_compiler()
        return ["ziglang"] if needs_zig and not importlib.util.find_spec("ziglang") else []

    def initialize(self, version: str, build_data: dict) -> None:
        if self.target_name != "wheel":
            return
        build_data["pure_python"] = False
        if platform := os.environ.get(WHEEL_FOR):
            self._cross_compile(platform, build_data)
            return
        if version != "editable":  # there it is built at the first use
            self._build_page(build_data)
        objects = Path(self.root) / "build" / "objects"
        libraries = [
            compile_library(HERE, objects=objects),
            compile_fmu_library(RUNTIME / FMU_LIBRARY, objects=objects),
            compile_python_library(PYTHON_RUNTIME / PYTHON_LIBRARY, objects=objects),
        ]
        build_data["tag"] = "py3-none-" + sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["artifacts"] += [library.relative_to(Path(self.root)).as_posix() for library in libraries]

    def _cross_compile(self, platform: str, build_data: dict) -> None:
        """Libraries for another platform go into the wheel only: the tree keeps those of this one.  Raises RuntimeError."""
        if platform not in TARGETS:
            raise RuntimeError(f"{WHEEL_FOR} = {platform!r} is no platform; use one of {', '.join(TARGETS)}")
        self._build_page(build_data, needed=True)
        self._scratch = tempfile.TemporaryDirectory()
        compilers = {
            "kernel": (HERE, compile_kernel),
            "native": (RUNTIME, compile_fmu_library),
            "python": (PYTHON_RUNTIME, compile_python_library),
        }
        for kind, (folder, compiler) in compilers.items():
            target = Path(self._scratch.name) / file_name(kind, platform)
            library = compiler(target, platform, Path(self.root) / "build" / "objects")
            build_data["force_include"][str(library)] = (folder / library.name).relative_to(Path(self.root)).as_posix()
        build_data["tag"] = f"py3-none-{TARGETS[platform].tag}"

    def _build_page(self, build_data: dict, needed: bool = False) -> None:
        """What web pages have in common goes into the wheel only; in the tree it is kept for the next time.

        needed: raise RuntimeError where the tools are missing, else the wheel does without, and `tensegrity view` builds it.
        """
        place = HERE.parent / "output" / "page"
        bundle: Any = types.ModuleType("bundle")
        bundle.__file__ = str(place / "bundle.py")
        exec((place / "bundle.py").read_text(encoding="utf-8"), vars(bundle))  # the package cannot be imported yet
        if missing := bundle.missing():
            problem = f"web pages are not built into the wheel, for want of {' and '.join(missing)}"
            if needed:
                raise RuntimeError(f"{problem}: pip install {' '.join(missing)}")
            self.app.display_warning(problem)
            return
        this = types.SimpleNamespace(**globals())  # the builder keeps this module among no others
        folder = Path(self.root) / "build" / "page" / bundle.digest(this)
        if not folder.is_dir():
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder.parent) as work:
                fresh = Path(work) / "files"
                fresh.mkdir()
                bundle.make(fresh, this)
                with contextlib.suppress(OSError):  # another build was faster
                    fresh.rename(folder)
        for name in bundle.FILES:
            build_data["force_include"][str(folder / name)] = (place / "built" / name).relative_to(Path(self.root)).as_posix()

    def finalize(self, version: str, build_data: dict, artifact_path: str) -> None:
        if hasattr(self, "_scratch"):
            self._scratch.cleanup()
