"""What may be asked of a build."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_core.errors import InputError
from tensegrity_core.native.build import TARGETS

from ..packing.libraries import TUPLES
from ..packing.ssp import VERSIONS
from ..validation.validate import CACHE
from ..variables.described import KINDS, STANDARDS


@dataclass(frozen=True)
class Options:
    """What is built of each scene, and how it is checked.

    scenes: names or paths; runtimes: of "native", "python"; fmi: one of STANDARDS; kind: one of KINDS; platforms: beside
    this one, keys of TARGETS; sources, binaries, cross_check: of native FMUs; simple: see Contents; page: the page in which
    the scene moves goes into their documentation and beside the reports; apart: actuators as FMUs of their own; ssp: version
    of the archive that couples these with the structure, None for none; cache: folder of reference runs, None for none; json:
    the table as JSON on standard output, and everything else on standard error.
    """

    scenes: tuple[str, ...]
    runtimes: tuple[str, ...] = ("native", "python")
    fmi: str = "2.0"
    kind: str = "cs"
    platforms: tuple[str, ...] = ()
    sources: bool = False
    binaries: bool = True
    simple: bool = False
    page: bool = True
    cross_check: Path | None = None
    output: Path = Path("dist")
    apart: bool = False
    ssp: str | None = None
    naming: str = "structured"
    validate: bool = True
    thorough: bool = False
    cache: Path | None = CACHE
    json: bool = False

    def __post_init__(self):
        """Raises InputError."""
        if not self.scenes:
            raise InputError("no scene is named; name one, or give --all")
        if not (self.runtimes and set(self.runtimes) <= {"native", "python"}):
            raise InputError(f"runtime = {', '.join(map(str, self.runtimes))!r} is none; use native, python or both")
        if self.kind not in KINDS:
            raise InputError(f"--kind {self.kind}: there is no such kind; use {', '.join(KINDS)}")
        if self.fmi not in STANDARDS:
            raise InputError(f"--fmi {self.fmi}: FMUs are not written in that version; use {' or '.join(STANDARDS)}")
        self._require_together()
        if self.simple and self.validate:
            raise InputError("--simple-types leaves outputs out that the validation reads: give --no-validate, too")
        if self.ssp is not None and self.ssp not in VERSIONS:
            raise InputError(f"--ssp {self.ssp}: no such version is written; use {' or '.join(VERSIONS)}")
        if self.ssp and not self.apart:
            raise InputError("--ssp couples a structure with actuators of their own: give --detach-actuators, too")
        if self.thorough and not self.validate:
            raise InputError("--thorough is a kind of validation: leave it or --no-validate out")
        asked = {"--sources": self.sources, "--no-binaries": not self.binaries, "--cross-check": self.cross_check}
        native = [option for option, given in asked.items() if given]
        if native and "native" not in self.runtimes:
            raise InputError(f"{', '.join(native)}: for native FMUs, which --runtime python leaves out")

        if not self.binaries and not self.sources:
            raise InputError("--no-binaries leaves nothing that could run: give --sources, too")
        if not self.binaries and (self.validate or self.platforms):
            told = "validated: give --no-validate, too" if self.validate else "compiled here: leave --platforms out"
            raise InputError(f"--no-binaries leaves nothing that could be {told}")

    def _require_together(self) -> None:
        """Raises InputError where model exchange or FMI 3.0 does not go with what else is asked for."""
        python, wanted = "--runtime python: the Python runtime has {} only; give --runtime native", "python" in self.runtimes
        exchange: dict[str, Any] = {
            python.format("co-simulation"): wanted,
            "--simple-types": self.simple,
            "--detach-actuators": self.apart,
        }
        fmi3: dict[str, Any] = {
            python.format("FMI 2.0"): wanted,
            "--ssp": self.ssp,
        }

        def remedy(option: str, other: str) -> str:
            return "" if ";" in option else f"; leave {other} or {option} out"

        for option in (option for option, given in exchange.items() if given and self.kind != "cs"):
            raise InputError(f"--kind {self.kind} does not go with {option}{remedy(option, '--kind')}")
        for option in (option for option, given in fmi3.items() if given and self.fmi != "2.0"):
            raise InputError(f"--fmi {self.fmi} does not go with {option}{remedy(option, '--fmi')}")

    def folder(self, runtime: str) -> Path:
        """Where the FMUs of a runtime go."""
        name = runtime if self.kind == "cs" else self.kind
        return self.output / (name if self.fmi == "2.0" else f"{name}-fmi{self.fmi[0]}")

    def label(self, name: str) -> str:
        """What table and reports call an FMU by its runtime or kind: with the version of FMI, where that is not the usual."""
        return name if self.fmi == "2.0" else f"{name}, FMI {self.fmi}"


def runtimes(name: str, native: bool) -> tuple[str, ...]:
    """What a name comes to, "both" too.  native: what is asked for is there in the native runtime only."""
    if name != "both":
        return (name,)
    return ("native",) if native else ("native", "python")


def platforms(text: str) -> tuple[str, ...]:
    """Keys of TARGETS out of what follows --platforms, which may be FMI 3.0's names, too.  Raises InputError."""
    names = tuple(name for name in map(str.strip, text.split(",")) if name)
    if names == ("all",):
        return tuple(TARGETS)
    usual = {other: name for name, other in TUPLES.items()}
    for name in names:
        if usual.get(name, name) not in TARGETS:
            raise InputError(f"--platforms: no platform is called {name!r}; use {', '.join(TARGETS)}, or all")
    return tuple(dict.fromkeys(usual.get(name, name) for name in names))
