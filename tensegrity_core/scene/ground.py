"""What may be wrong with the ground of a scene."""

from __future__ import annotations

from .entries import Ground, Scene
from .messages import require_known, twice


def check_ground(scene: Scene) -> None:
    """Raises SceneError."""
    ground = scene.ground
    if ground is None:
        return
    _check_plane(scene, ground)
    held = scene.held
    for at, name in enumerate(ground.nodes or (), 1):
        _require_free(scene, f"ground.nodes[{at}]", name, held)
    twice(scene, "ground.nodes", ground.nodes or ())
    named = scene.touching
    if not named:
        raise scene.error("ground", "has no node that could touch it: all are fixed", "Free a node, or leave the ground out.")
    for name in named if ground.law == "literal" else ():
        if scene.contact(name)["friction"] > 0.0:
            own = name in ground.at and ground.at[name].friction is not None
            key = f"ground.at.{name}.friction" if own else "ground.friction"
            problem = f'is not 0 at {name}, where the law "literal" lets N be negative'
            raise scene.error(key, problem, 'Write friction = 0.0, or law = "clipped".')
    for name in ground.at:
        _require_free(scene, f"ground.at.{name}", name, held)
        if name not in named:
            raise scene.error(f"ground.at.{name}", "is not listed in ground.nodes", f"List {name} there, or leave this out.")


def _require_free(scene: Scene, key: str, name: str, held: dict[str, tuple[int, ...]]) -> None:
    require_known(scene, key, name, scene.nodes)
    if held.get(name) == scene.axes:
        raise scene.error(key, f"{name} is fixed, so the ground cannot move it", "Name a node that can move, or leave it out.")


def _check_plane(scene: Scene, ground: Ground) -> None:
    letters = scene.plane or "xyz"
    for key in ("point", "normal"):
        given = getattr(ground, key)
        if given is not None and len(given) != len(letters):
            kind = f"planar scene ({scene.plane})" if scene.plane else "3D scene"
            problem = f"has {len(given)} components in a {kind}"
            raise scene.error(f"ground.{key}", problem, f"Give {len(letters)}: [{', '.join(letters)}].")
    if ground.normal is None and 2 not in scene.axes:
        problem = "has no normal, and the scene no z axis along which it would be"
        raise scene.error("ground", problem, f"Give normal = [{', '.join(letters)}].")
    if ground.normal is not None and not any(ground.normal):
        raise scene.error("ground.normal", "has no direction", "Give a vector that is not 0.")
