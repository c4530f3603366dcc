"""The units of an FMU's variables: what a description says of each."""

from __future__ import annotations

import math
from typing import NamedTuple

from tensegrity_core.fields import FIELDS, Field


class Unit(NamedTuple):
    """base: exponents of the base units; quantity: what it measures, called as in the Modelica Standard Library where it has
    it; shown: units in which people read it, and the factor from this one; by_default: whether values are shown in the first of
    these unless the user chooses another."""

    base: dict[str, int]
    quantity: str | None
    shown: dict[str, float]
    by_default: bool = False


UNITS = {
    "1": Unit({}, None, {}),
    "m": Unit({"m": 1}, "Length", {"mm": 1e3, "cm": 1e2}, by_default=True),
    "s": Unit({"s": 1}, "Time", {"ms": 1e3}, by_default=True),
    "kg": Unit({"kg": 1}, "Mass", {"g": 1e3}),
    "m/s": Unit({"m": 1, "s": -1}, "Velocity", {"mm/s": 1e3}),
    "s/m": Unit({"m": -1, "s": 1}, "Slowness", {}),
    "m/s2": Unit({"m": 1, "s": -2}, "Acceleration", {}),
    "N": Unit({"kg": 1, "m": 1, "s": -2}, "Force", {"kN": 1e-3}),
    "N/m": Unit({"kg": 1, "s": -2}, "TranslationalSpringConstant", {"N/mm": 1e-3, "kN/m": 1e-3}),
    "N.s/m": Unit({"kg": 1, "s": -1}, "TranslationalDampingConstant", {}),
    "N.m2": Unit({"kg": 1, "m": 3, "s": -2}, "BendingStiffness", {}),
    "J": Unit({"kg": 1, "m": 2, "s": -2}, "Energy", {"mJ": 1e3}),
    "W": Unit({"kg": 1, "m": 2, "s": -3}, "Power", {"mW": 1e3}),
    "A": Unit({"A": 1}, "ElectricCurrent", {"mA": 1e3}),
    "rad/s": Unit({"rad": 1, "s": -1}, "AngularVelocity", {"rpm": 30.0 / math.pi, "deg/s": 180.0 / math.pi}, by_default=True),
    "kg.m2": Unit({"kg": 1, "m": 2}, "MomentOfInertia", {"kg.cm2": 1e4}, by_default=True),
    "N.m.s": Unit({"kg": 1, "m": 2, "s": -1}, "RotationalDampingConstant", {"mN.m.s": 1e3}),
    "N.m/A": Unit({"kg": 1, "m": 2, "s": -2, "A": -1}, "ElectricalTorqueConstant", {"mN.m/A": 1e3}),
}


def require_known(fields: tuple[Field, ...]) -> None:
    """Raises ValueError where a field has a unit that is not among UNITS."""
    for field in fields:
        if field.unit not in UNITS:
            raise ValueError(
                f"fields.py: {field.name!r} has the unit {field.unit!r}, which FMUs do not know; "
                f"give it a row in UNITS of fmu_src/variables/units.py, or choose from {', '.join(UNITS)}"
            )


require_known(FIELDS)
