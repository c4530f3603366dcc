"""Builds FMUs of scenes, validates them against the reference, and says how it went."""

from ..validation.validate import CACHE
from .options import Options, platforms, runtimes
from .run import built, make

__all__ = ["CACHE", "Options", "built", "make", "platforms", "runtimes"]
