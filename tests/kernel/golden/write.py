"""Write the golden trajectories: ``python -m tests.kernel.golden.write``.  Run it only when the physics is meant to change.

They come from the reference alone: half a second of the asymmetric push, positions and tensions at ten instants.
"""

import json
from pathlib import Path

from tensegrity_core import reference
from tensegrity_core.model import grid, held
from tensegrity_core.scene import builtin_scenes
from tests.support import push, scene
from tests.support.words import words

HERE = Path(__file__).resolve().parent
DURATION, STEP = 0.5, 0.05


def inputs(model):
    """The asymmetric push, held for the whole run."""
    force = push(model)
    return held(model, grid(DURATION, STEP), force=lambda t: force)


def main() -> None:
    for name in builtin_scenes():
        model = scene(name)
        run = reference.simulate(model, inputs(model))
        rows = {"position": run.position[:, model.free_nodes].tolist(), "string_force": run.string_force.tolist()}
        rows["transitions"] = [[t.time, t.string, t.before, t.after] for t in run.transitions]
        (HERE / f"{name}.json").write_text(json.dumps(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    words(__doc__)
    main()
