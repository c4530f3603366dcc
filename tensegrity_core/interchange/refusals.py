"""What of a scene another program's file cannot say."""

from __future__ import annotations

from collections.abc import Iterable

from ..errors import InputError
from ..model import Model

MOST_NAMES = 6


def require_springs(model: Model, what: str, *more: str) -> None:
    """Raises InputError with all of it where a string is more than a spring with a linear damper, or where more is named."""
    found = list(more)
    kinds: dict[str, Iterable[int]] = {
        "NSH": model.honeycombs,
        "force law": {i: one for i, one in enumerate(model.element) if one},
    }
    kinds["damper"] = {i: one for i, one in enumerate(model.damper) if one}
    for kind, strings in kinds.items():
        names = [model.string_names[i] for i in strings]
        shown = ", ".join(names[:MOST_NAMES]) + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")
        found += [f"the {kind} of {shown}"] if names else []
    if found:
        raise InputError(f"{model.name}: {what} cannot say {'; '.join(found)}; export a scene without")
