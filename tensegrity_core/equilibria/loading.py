"""A load that moves with one parameter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..model import Model


@dataclass(frozen=True, eq=False)
class Loading:
    """force + p force_direction: (N, 3) N; rest_length + p rest_length_direction: (S,) m; None: no force, the model's rest
    lengths, no change."""

    model: Model
    force_direction: np.ndarray = None  # type: ignore[assignment]  # arrays once they are given
    rest_length_direction: np.ndarray = None  # type: ignore[assignment]
    force: np.ndarray = None  # type: ignore[assignment]
    rest_length: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self):
        nodes, strings = self.model.nodes.shape, self.model.rest_length.shape
        defaults = {"force_direction": np.zeros(nodes), "rest_length_direction": np.zeros(strings)}
        defaults |= {"force": np.zeros(nodes), "rest_length": self.model.rest_length}
        for name, default in defaults.items():
            given = getattr(self, name)
            value = default if given is None else np.asarray(given, dtype=float)
            if value.shape != default.shape or not np.isfinite(value).all():
                raise InputError(f"{name} = {given!r}: give finite numbers of shape {default.shape}")
            object.__setattr__(self, name, value)

    def check(self, *parameters: float) -> None:
        """Raise InputError where nothing changes with p, or where a rest length would be negative at one of these."""
        if not (self.force_direction[self.model.free_nodes].any() or self.rest_length_direction.any()):
            raise InputError(
                "force_direction and rest_length_direction are zero at every free node and string; give a load that changes"
            )
        for parameter in parameters:
            lengths = self.rest_lengths(parameter)
            if lengths.min(initial=0.0) < 0.0:
                name = self.model.string_names[int(np.argmin(lengths))]
                raise InputError(
                    f"p = {parameter:g} makes the rest length of {name} {lengths.min():.6g} m; it cannot be "
                    "negative, so let p end earlier"
                )

    def forces(self, parameter: float) -> np.ndarray:
        """(N, 3) N."""
        return self.force + parameter * self.force_direction

    def rest_lengths(self, parameter: float) -> np.ndarray:
        """(S,) m."""
        return self.rest_length + parameter * self.rest_length_direction if self.winds else self.rest_length

    @cached_property
    def winds(self) -> bool:
        """Whether rest lengths change with p."""
        return bool(self.rest_length_direction.any())

    def model_at(self, parameter: float, nodes: np.ndarray) -> Model:
        """The model with its start at nodes (N, 3) m, and with the rest lengths there."""
        return replace(self.model, nodes=nodes, rest_length=self.rest_lengths(parameter))
