"""The list of fields that Python, the C kernel and both FMU runtimes share.

Every real variable of a simulation (inputs, parameters, outputs) lives in one contiguous block of doubles, in the order
of `FIELDS`; a variable's index in that block is its value reference in both FMUs.  Integer variables live in a second
block, in the order of `INTEGER_FIELDS`; their value references follow those of the reals.

Adding a field: add its row here, run ``python -m tensegrity_core.fields`` (rewrites native/fields.h), fill it in
native/outputs.c (outputs) or read it in native/ (inputs, parameters), and give it a name in fmu_src/interface.py.

This module imports nothing, so that the build can run it.
"""

from __future__ import annotations

from typing import NamedTuple


class Field(NamedTuple):
    """One row.  shape: counts as named in `COUNTS`, row-major; role: input, tunable, fixed or output."""

    name: str
    role: str
    shape: tuple[str, ...]
    unit: str
    meaning: str


#: What a shape counts: letter -> meaning.
COUNTS = {
    "D": "axes that the scene uses: 3, or 2 in a planar scene",
    "N": "nodes",
    "F": "free nodes, in node order",
    "G": "fixed nodes, in node order",
    "B": "bars",
    "S": "strings",
    "H": "strings with an NSH, in string order",
    "Z": "beams of all NSH strings, string by string",
    "V": "components of gravity: 1 (towards -z), or one for each axis that the scene uses",
    "P": "nodes with a point mass, in node order",
    "R": "nodes with viscous drag, in node order",
    "E": "fixed nodes whose motion is prescribed, in node order",
    "A": "strings with an actuator, in string order",
}

FIELDS = (
    Field("force", "input", ("F", "D"), "N", "external force on a free node, held over a step"),
    Field("rest_length", "input", ("S",), "m", "rest length at the start of the next step"),
    Field("rest_length_rate", "input", ("S",), "m/s", "rate of the rest length during the next step"),
    Field("current", "input", ("A",), "A", "current of an actuator's motor, held over a step"),
    Field("drum_load", "input", ("A",), "N", "pull on an actuator's drum beside its string's tension"),
    Field("node_position", "input", ("E", "D"), "m", "position of a moved node at the start of the next step"),
    Field("node_velocity", "input", ("E", "D"), "m/s", "its velocity then"),
    Field("node_acceleration", "input", ("E", "D"), "m/s2", "its acceleration during the next step"),
    Field("stiffness", "tunable", ("S",), "N/m", "stiffness; of an NSH string: once the NSH has bottomed out"),
    Field("damping", "tunable", ("S",), "N.s/m", "damping coefficient"),
    Field("gravity", "tunable", ("V",), "m/s2", "gravity: towards -z, or a vector's component"),
    Field("drag", "tunable", ("R",), "N.s/m", "drag coefficient of a node: force per velocity"),
    Field("bar_mass", "fixed", ("B",), "kg", "mass"),
    Field("point_mass", "fixed", ("P",), "kg", "mass at a node, beside its bar's"),
    Field("nsh_Q", "fixed", ("Z",), "N", "force scale of a beam, eq. 11"),
    Field("nsh_zeta", "fixed", ("Z",), "1", "shape parameter of a beam, eq. 11"),
    Field("nsh_h", "fixed", ("Z",), "m", "height of a beam's arch, eq. 11"),
    Field("motor_inertia", "fixed", ("A",), "kg.m2", "moment of inertia J_a of motor and drum, eq. 8"),
    Field("motor_damping", "fixed", ("A",), "N.m.s", "damping d_a of the motor: torque per speed, eq. 8"),
    Field("torque_constant", "fixed", ("A",), "N.m/A", "torque k_a per current, eq. 8"),
    Field("drum_radius", "fixed", ("A",), "m", "radius r of the drum that winds the string in"),
    Field("tolerance", "fixed", (), "1", "error per step: relative, and absolute in m and m/s"),
    Field("max_step", "fixed", (), "s", "largest step of the integrator, 0: no limit; the step of rk4 and ros2, 0: 1 ms"),
    Field("position", "output", ("N", "D"), "m", "node positions"),
    Field("velocity", "output", ("F", "D"), "m/s", "velocities of the free nodes"),
    Field("string_force", "output", ("S",), "N", "tension, elastic and damping"),
    Field("elastic_force", "output", ("S",), "N", "elastic tension"),
    Field("string_length", "output", ("S",), "m", "length"),
    Field("wound_rest_length", "output", ("A",), "m", "rest length of a string with an actuator"),
    Field("wound_rest_length_rate", "output", ("A",), "m/s", "its rate"),
    Field("motor_speed", "output", ("A",), "rad/s", "speed at which the motor winds in"),
    Field("bar_force", "output", ("B",), "N", "axial force, mean over the bar: -lambda l of eq. 1, tension positive"),
    Field("reaction", "output", ("G", "D"), "N", "force of the ground on the structure at a fixed node"),
    Field("kinetic", "output", (), "J", "kinetic energy"),
    Field("potential", "output", (), "J", "gravitational potential energy, zero at z = 0"),
    Field("elastic", "output", (), "J", "energy stored in the strings"),
    Field("dissipated", "output", (), "J", "energy lost in dampers, drag, motors and snaps since the start"),
    Field("input_work", "output", (), "J", "work of all inputs and of parameter jumps since the start"),
    Field("throughput", "output", (), "J", "integral of the sum of |power|, the scale of the energy ledger"),
)

INTEGER_FIELDS = (
    Field("method", "fixed", (), "1", "integration method"),
    Field("snapped", "output", ("H",), "1", "beams of an NSH that are past their force maximum"),
)

#: Integration methods and what they are, in one line each; a method's place is its number in the kernel and in the FMUs.
#: Adding one: its line here, then ``python -m tensegrity_core.fields``, and native/NAME.c with the table `ts_NAME`.
METHOD_MEANINGS = {
    "auto": "explicit, and implicit where the motion is stiff",
    "dop853": "explicit Runge-Kutta method of order 8 by Dormand and Prince",
    "rodas5p": "L-stable Rosenbrock method of order 5",
    "radau9": "L-stable implicit Runge-Kutta method of order 9 (Radau IIA)",
    "rk4": "classical explicit Runge-Kutta method of order 4, fixed step",
    "ros2": "L-stable linearly implicit method of order 2, fixed step and fixed cost: for real time",
}
METHODS = tuple(METHOD_MEANINGS)

#: Damping laws by name; see model.md's section on strings: what a string does while its damper exceeds its spring.
DAMPING_LAWS = ("literal", "tension_only")


def size(field: Field, counts: dict[str, int]) -> int:
    """Number of values in `field` for a scene with these counts."""
    n = 1
    for letter in field.shape:
        n *= counts[letter]
    return n


def layout(counts: dict[str, int], fields: tuple[Field, ...] = FIELDS) -> dict[str, slice]:
    """Where each field stands in its block: name -> slice."""
    places, at = {}, 0
    for field in fields:
        n = size(field, counts)
        places[field.name] = slice(at, at + n)
        at += n
    return places


def c_header() -> str:
    """The same list as X-macros for the kernel: native/fields.h."""
    lines = [
        "/* Written by `python -m tensegrity_core.fields`; edit fields.py instead. */",
        "#ifndef TENSEGRITY_FIELDS_H",
        "#define TENSEGRITY_FIELDS_H",
        "",
        "enum { TS_ROLE_INPUT, TS_ROLE_TUNABLE, TS_ROLE_FIXED, TS_ROLE_OUTPUT };",
        "",
    ]
    for macro, prefix, fields in (("TS_FIELDS", "TS_", FIELDS), ("TS_INT_FIELDS", "TS_INT_", INTEGER_FIELDS)):
        lines.append(f"/* X(name, role, first count, second count): counts index ts_counts(), -1: none */\n#define {macro}(X) \\")
        for field in fields:
            shape = [f"TS_{letter}" for letter in field.shape] + ["-1", "-1"]
            row = f"    X({prefix}{field.name.upper()}, TS_ROLE_{field.role.upper()}, {shape[0]}, {shape[1]})"
            lines.append(f"{row} /* {field.unit}: {field.meaning} */ \\")
        lines.append("")
    lines += [
        "#define TS_NAME(name, role, first, second) name,",
        "enum { TS_FIELDS(TS_NAME) TS_FIELD_COUNT };",
        "enum { TS_INT_FIELDS(TS_NAME) TS_INT_FIELD_COUNT };",
        "#undef TS_NAME",
        "",
        "enum { " + ", ".join(f"TS_METHOD_{name.upper()}" for name in METHODS) + ", TS_METHOD_COUNT };",
        "#define TS_METHODS(X) " + " ".join(f"X({name.upper()}, {name})" for name in METHODS if name != "auto"),
        "enum { " + ", ".join(f"TS_{name.upper()}" for name in DAMPING_LAWS) + " };",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    from importlib import import_module  # not an import statement: FMUs pack what those of this module name
    from pathlib import Path

    files = import_module("tensegrity_core.files")
    files.write_text(Path(__file__).with_name("native") / "fields.h", c_header())
