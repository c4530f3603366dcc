"""What is simulated, as frozen arrays: a model and its elements, its inputs, and the result."""

from __future__ import annotations

from .ground import Contact, Ground
from .inputs import Inputs, grid, held
from .model import NSH, Actuator, Model
from .result import Result, Transition

__all__ = ["NSH", "Actuator", "Contact", "Ground", "Inputs", "Model", "Result", "Transition", "grid", "held"]
