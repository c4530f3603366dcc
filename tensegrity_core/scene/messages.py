"""What is said of a mistake in a scene file: key, value and remedy."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping
from itertools import islice
from typing import Any, get_args, get_origin

from pydantic import ValidationError

from ..errors import SceneError
from . import files as scene_files
from .entries import LONGEST_NAME, Entry, Scene
from .files import lookup


def translated(failure: ValidationError, raw: dict, origin: dict, file: str) -> SceneError:
    """The first of pydantic's findings in our own words; unknown keys come first, since a misspelt key is missing, too."""
    findings = failure.errors(include_url=False)
    finding = next((one for one in findings if one["type"] == "extra_forbidden"), findings[0])
    place, kind = tuple(part for part in finding["loc"] if part != "[key]"), finding["type"]
    if place[0] == "gravity":
        place = tuple(part for part in place if part not in ("[number]", "[vector]"))
    is_key = finding["loc"][-1] == "[key]"
    owner, field = _described(place)
    value = place[-1] if is_key else lookup(raw, place)
    if is_key and kind == "string_too_long":
        problem, remedy = _problem(kind, finding, value), "Choose a shorter name."
    elif is_key:
        problem, remedy = "is not an identifier", "Start with an ASCII letter; go on with letters, digits and _."
    elif kind == "extra_forbidden":
        problem = "is not a key of a scene file"
        remedy = f"{meant(str(place[-1]), owner.model_fields)}Keys here: {', '.join(owner.model_fields)}."
    else:
        problem = _problem(kind, finding, value)
        remedy = f"Give {field.description}."
    if kind == "missing" and isinstance(place[-1], int):  # a pair with one end
        place = place[:-1]
        value, problem = lookup(raw, place), "has too few entries"
    return scene_files.error(file, origin, place, value, problem, remedy)


def _problem(kind: str, finding: Mapping[str, Any], value: Any) -> str:
    context = finding.get("ctx", {})
    if kind == "greater_than_equal" and context["ge"] > 0.0 >= value:
        return "is not greater than 0"
    known = {
        "missing": "is missing",
        "finite_number": "is not a finite number",
        "float_type": "is not a number",
        "string_type": "is not a text",
        "tuple_type": "is not a list",
        "dict_type": "is not a table",
        "model_type": "is not a table",
        "greater_than": "is not greater than {gt}",
        "greater_than_equal": "is less than {ge}",
        "less_than_equal": "is greater than {le}",
        "too_short": "has too few entries",
        "too_long": "has too many entries",
        "literal_error": "is not one of {expected}",
        "string_too_long": "has more than {max_length} letters",
        "string_pattern_mismatch": "has a form that is not allowed",
    }
    return known[kind].format(**context) if kind in known else finding["msg"]


def _described(place: tuple) -> tuple[type[Entry], Any]:
    """The table that holds a place, and the field whose description says what belongs there."""
    owner: type[Entry] = Scene
    field = held = None
    for part in place:
        if held is not None:  # the name of a table in a table of such
            owner, held = held, None
        elif isinstance(part, str) and part in owner.model_fields:
            field = owner.model_fields[part]
            inner = [kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type(Entry))]
            if inner and get_origin(field.annotation) is dict:
                held = inner[0]
            elif inner:
                owner = inner[0]
    return owner, field


def twice(scene: Scene, key: str, names: tuple[str, ...]) -> None:
    """Raises SceneError where a list names something twice."""
    seen: set[str] = set()
    for at, name in enumerate(names, 1):
        if name in seen:
            raise scene.error(f"{key}[{at}]", "is listed twice", "Remove one of the two.")
        seen.add(name)


def require_known(scene: Scene, key: str, name: str, names: Collection[str], problem: str = "is no node") -> None:
    """Raises SceneError where a name that stands at a key is none of these."""
    if name in names:
        return
    listed = list(islice(names, 13))
    shown = ", ".join(listed[:12]) + (", ..." if len(listed) > 12 else "")
    choices = f"Choose from: {shown}." if listed else "There is none yet: add it."
    raise scene.error(key, problem, meant(name, names).strip() or choices)


def meant(wanted: str, names: Collection[str]) -> str:
    """Asks for the name that is most like a wanted one, if any is; not looked for where that would take long."""
    if len(wanted) > LONGEST_NAME or len(names) > 5000:
        return ""
    return "".join(f"Did you mean {name}? " for name in difflib.get_close_matches(wanted, list(names), 1))
