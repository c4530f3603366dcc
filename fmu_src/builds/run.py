"""A build from beginning to end."""

from __future__ import annotations

import sys
from pathlib import Path

from tensegrity_core.errors import TensegrityError, shown
from tensegrity_core.progress import Bar
from tensegrity_core.scene import load_scene

from ..packing.libraries import here
from .judgement import validate
from .options import Options
from .packs import compile_first, live_pages, make_folder, pack, pack_all, unique
from .work import Work


def make(options: Options) -> int:
    """Build and validate.  Returns the exit code: 0; 1 where a bound was passed or a validation failed; 2 where nothing
    could be built."""
    with Bar("building") as bar:
        try:
            if options.binaries:
                here()
            models = unique([load_scene(scene) for scene in options.scenes])
            work = Work(options, bar, len(models))
            pages = live_pages(models, work)
            built = pack_all(models, pages, work)
        except (TensegrityError, OSError) as error:
            with bar.aside():
                print(f"error: {shown(str(error))}", file=sys.stderr)
            return 2
        return validate(models, built, pages, work) if options.validate else 0


def built(options: Options) -> dict[str, Path]:
    """The FMUs of one scene by their runtimes, for scripts.  Raises TensegrityError, also where a bound was passed."""
    (model,) = unique([load_scene(scene) for scene in options.scenes]).values()
    with Bar("building") as bar:
        work = Work(options, bar, 1)
        make_folder(options.output)
        compile_first(work)
        pages = live_pages({model.name: model}, work)
        found = {runtime: pack(model, runtime, options, pages.get(model.name)) for runtime in options.runtimes}
        named = {(model.name, runtime): path for runtime, path in found.items()}
        if options.validate and validate({model.name: model}, named, pages, work):
            raise TensegrityError(
                f"{model.name}: the validation failed; what passed its bound stands in the reports beside the FMUs"
            )
    return found
