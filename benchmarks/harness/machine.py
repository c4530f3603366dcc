"""What a benchmark ran on, written into every result file."""

from __future__ import annotations

import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy
import scipy

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
