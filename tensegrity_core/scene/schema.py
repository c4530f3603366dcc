"""The JSON schema of scene files, for editors."""

from __future__ import annotations

import json
from typing import Any

from .entries import Scene
from .files import EXTENDS_MEANING


def scene_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of the scene file, for editors.

    A file with `extends` may leave out any key, so "required" holds only without it.
    """
    schema = _tidied(Scene.model_json_schema())
    definitions = schema.pop("$defs")
    complete = _requirements(schema, definitions)
    complete["required"] = [key for key in complete["required"] if key != "name"]  # the file's name serves
    for table in (schema, *definitions.values()):
        table.pop("required", None)
    schema["properties"] = {
        "extends": {
            "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
            "description": EXTENDS_MEANING,
        },
        **schema["properties"],
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "Tensegrity scene",
        "description": "A tensegrity structure in SI units.",
        "if": {"not": {"required": ["extends"]}},
        "then": complete,
        "$defs": definitions,
    }


def _tidied(schema: Any) -> Any:
    """The same without generated titles and nulls (TOML has none), and with names that fit no pattern refused."""
    if isinstance(schema, list):
        return [_tidied(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    tidy = {key: _tidied(part) for key, part in schema.items() if not (key == "title" and isinstance(part, str))}
    choices = [choice for choice in tidy.get("anyOf", ()) if choice != {"type": "null"}]
    if len(choices) == 1:
        del tidy["anyOf"]
        tidy = choices[0] | tidy
    if tidy.get("default", ...) is None:
        del tidy["default"]
    if "patternProperties" in tidy:
        tidy["additionalProperties"] = False
    return tidy


def _requirements(schema: dict, definitions: dict) -> dict:
    """Only the "required" parts of a schema, references followed."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rsplit("/", 1)[1]]
    found: dict[str, Any] = {"required": schema["required"]} if "required" in schema else {}
    inner = {key: _requirements(part, definitions) for key, part in schema.get("properties", {}).items()}
    if any(inner.values()):
        found["properties"] = {key: part for key, part in inner.items() if part}
    for key in ("additionalProperties", "patternProperties"):
        if isinstance(schema.get(key), dict):
            part = schema[key]
            nested = (
                {pattern: _requirements(value, definitions) for pattern, value in part.items()}
                if key == "patternProperties"
                else _requirements(part, definitions)
            )
            if any(nested.values()):
                found[key] = nested
    return found


def schema_text() -> str:
    """The schema as it stands in scenes/scene.schema.json."""
    return json.dumps(scene_schema(), indent=2, sort_keys=False) + "\n"
