"""A build under way: how far it has come, and what is said meanwhile."""

from __future__ import annotations

import sys

from tensegrity_core.output.page import found as page_parts
from tensegrity_core.progress import Bar, Shares

from .options import Options

#: About how long it takes, s: to compile a library, to build what pages have in common, to pack an FMU, to run one from
#: outside, to run the references of a scene, to write an FMU's report.
COMPILING, PAGING, PACKING, RUNNING, REFERENCES, REPORTING = 10.0, 15.0, 0.5, 1.5, 8.0, 1.0


class Work:
    """A build under way: how far its stages have come, and what is said meanwhile, out of the bar's way."""

    def __init__(self, options: Options, bar: Bar, scenes: int):
        self.options, self.bar = options, bar
        shares, fmus, validated = Shares(bar), scenes * len(options.runtimes), float(options.validate)
        self.compiling = shares.share(len(options.platforms) * len(options.runtimes) * COMPILING)
        self.paging = shares.share(PAGING if options.page and page_parts() is None else 0.0)
        self.packing = shares.share(fmus * PACKING)
        self.running = shares.share(fmus * RUNNING * validated)
        self.integrating = shares.share(scenes * REFERENCES * validated)
        self.reporting = shares.share(fmus * REPORTING * validated)

    def say(self, text: str) -> None:
        """A line for whoever waits, at once, wherever it goes."""
        with self.bar.aside():
            print(text, file=sys.stderr if self.options.json else sys.stdout, flush=True)

    def tell(self, text: str) -> None:
        """What was asked for."""
        self.bar.end()
        print(text)

    def fail(self, name: str, reason: object) -> int:
        with self.bar.aside():
            print(f"FAILED {name}: {reason}", file=sys.stderr, flush=True)
        return 1


class Notes:
    """Says each thing once, on stderr."""

    def __init__(self, work: Work):
        self._work, self._said = work, set()  # type: ignore[var-annotated]

    def add(self, *texts: str) -> None:
        for text in texts:
            if text not in self._said:
                self._said.add(text)
                with self._work.bar.aside():
                    print(f"note: {text}", file=sys.stderr, flush=True)
