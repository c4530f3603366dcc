"""What a benchmark ran on, written into every result file, and the command of those that write one page."""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy
import scipy

from tensegrity_core.files import write_text

ROOT = Path(__file__).resolve().parent.parent.parent


def _git(*arguments: str) -> str:
    try:
        run = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return run.stdout.strip()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def describe() -> dict[str, str]:
    """Processor, system, versions, commit (with a + where the tree differs from it) and date.

    docs/ does not count: it holds what benchmarks write, one after the other.  A difference is said on stderr, because what
    is measured cannot be measured again then.
    """
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    changed = _git("status", "--porcelain", "--", ".", ":(exclude)docs")
    if changed:
        print(f"warning: the tree differs from commit {commit}: {len(changed.splitlines())} files", file=sys.stderr)
    return {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "commit": commit + ("+" if changed else ""),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
    }


def write_page(
    about: str,
    name: str,
    rounds: int,
    collect: Callable[[int], dict],
    report: Callable[[dict], str],
    arguments: list[str] | None,
) -> None:
    """The command of a benchmark with one page: measures, or reads what was measured, and writes docs/NAME.json and its page.

    about: its help; rounds: by default; collect(rounds): the data; report(data): the page.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=rounds)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--redraw", action="store_true", help=f"write the page again from {name}.json, without measuring")
    options = parser.parse_args(arguments)
    data = options.output / f"{name}.json"
    if options.redraw:
        result = json.loads(data.read_text(encoding="utf-8"))
    else:
        result = collect(options.rounds)
        options.output.mkdir(parents=True, exist_ok=True)
        write_text(data, json.dumps(result, indent=1) + "\n")
    text = report(result)
    write_text(options.output / f"{name.replace('_', '-')}.md", text)
    print(text)
