"""What is simulated, as frozen arrays: a model and its elements, its inputs, and the result."""

from __future__ import annotations

from .inputs import Inputs, grid, held
from .model import NSH, Actuator, Model
from .result import Result, Transition

__all__ = ["NSH", "Actuator", "Inputs", "Model", "Result", "Transition", "grid", "held"]
