"""The subcommand `tensegrity check`: what a scene is, and whether it stands."""

from __future__ import annotations

from .options import Debug, Json, Scene
from .program import tell


def check(scene: Scene, json: Json = False, debug: Debug = False) -> None:
    """Check a scene file and summarise its structure: statics, stability, member forces and rest lengths at the start."""
    from ..output import structure_summary
    from ..progress import Bar
    from .words import model_of

    with Bar(f"reading {scene}") as bar:
        model, start = model_of(scene, bar)
    tell(structure_summary.data(model, start) if json else structure_summary.summary(model, start))
