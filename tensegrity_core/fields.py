"""The list of fields that Python, the C kernel and both FMU runtimes share.

Every real variable of a simulation (inputs, parameters, outputs) lives in one contiguous block of doubles, in the order
of `FIELDS`; a variable's index in that block is its value reference in both FMUs.  Integer variables live in a second
block, in the order of `INTEGER_FIELDS`; their value references follow those of the reals.

Adding an output: its row here, then ``python -m tensegrity_core.fields`` (rewrites native/fields.h); its value in the kernel,
native/motion/outputs.c, and its value in the reference, `reference.run._Run._record`.  Everything else follows: the FMUs'
variables, description and documentation, results and their files, validation.

Adding an input: its row with a `start`, then the same command; its effect in the kernel, for a force on nodes
native/motion/kinematics.h, and in the reference, reference/instant.py, where `Load` has it by its name.  Everything else
follows, the signals under which FMUs are validated, too.

This module imports nothing, so that the build can run it.
"""

from __future__ import annotations

from typing import NamedTuple


class Field(NamedTuple):
    """One row.

    role: input, tunable, fixed or output; shape: counts as named in `COUNTS`, row-major; variable: the name of its variables,
    {letter} being the component or the axis that a letter of the shape counts, {beam} the beam of an NSH from 1;
    low, high: bounds, None: any finite number; compared: of an output, how it is compared, a key of `COMPARED`; jumps: of an
    output, whether it jumps at transitions; rate_of: the field of the same component whose time derivative it is; start: the
    value of an input or a parameter where nothing else is said, None: the model's.
    """

    name: str
    role: str
    shape: tuple[str, ...]
    unit: str
    variable: str
    meaning: str
    low: float | None = None
    high: float | None = None
    compared: str = ""
    jumps: bool = False
    rate_of: str = ""
    start: float | None = None


#: The smallest number that counts as positive (a normal double).
POSITIVE = 2.2250738585072014e-308

#: How outputs are compared: class -> unit of its differences, "" where none are taken.  Energies are integrals and are compared
#: on the scale of the energy that has passed, the `scale`; counts have to be equal.
COMPARED = {
    "position": "m",
    "length": "m",
    "velocity": "m/s",
    "rest length rate": "m/s",
    "motor speed": "rad/s",
    "force": "N",
    "utilisation": "1",
    "energy": "J",
    "scale": "",
    "count": "",
}


#: What a shape counts: letter -> meaning.
COUNTS = {
    "D": "axes that the scene uses: 3, or 2 in a planar scene",
    "N": "nodes",
    "F": "free nodes, in node order: those that are not fixed along all axes",
    "G": "nodes fixed along any axis, in node order",
    "B": "bars",
    "S": "strings",
    "H": "strings with an NSH, in string order",
    "Z": "beams of all NSH strings, string by string",
    "V": "components of gravity: 1 (towards -z), or one for each axis that the scene uses",
    "P": "nodes with a point mass, in node order",
    "R": "nodes with viscous drag, in node order",
    "E": "fixed nodes whose motion is prescribed, in node order",
    "A": "strings with an actuator, in string order",
    "K": "nodes that may touch the ground, in node order",
    "W": "heights of the ground that are inputs: 1 where it moves, else 0",
    "M": "strings with mass, in string order",
    "C": "bars with a section, in bar order",
    "T": "strings with a strength, in string order",
}

# A table, with one or two lines a row:
# fmt: off
FIELDS = (
    Field("force", "input", ("F", "D"), "N", "{F}.force.{D}", "external force on a free node, held over a step", start=0.0),
    Field("rest_length", "input", ("S",), "m", "{S}.rest_length", "rest length at the start of the next step", low=0.0),
    Field("rest_length_rate", "input", ("S",), "m/s", "{S}.rest_length_rate",
          "rate of the rest length during the next step", rate_of="rest_length", start=0.0),
    Field("current", "input", ("A",), "A", "{A}.current", "current of an actuator's motor, held over a step"),
    Field("drum_load", "input", ("A",), "N", "{A}.actuator.load", "pull on an actuator's drum beside its string's tension"),
    Field("node_position", "input", ("E", "D"), "m", "{E}.position.{D}",
          "position of a moved node at the start of the next step"),
    Field("node_velocity", "input", ("E", "D"), "m/s", "{E}.velocity.{D}", "its velocity then", rate_of="node_position"),
    Field("node_acceleration", "input", ("E", "D"), "m/s2", "{E}.acceleration.{D}",
          "its acceleration during the next step", rate_of="node_velocity", start=0.0),
    Field("ground_height", "input", ("W",), "m", "ground{W}.height",
          "height of the ground along its normal at the start of the next step", start=0.0),
    Field("ground_velocity", "input", ("W",), "m/s", "ground{W}.velocity", "its rate then", rate_of="ground_height", start=0.0),
    Field("ground_acceleration", "input", ("W",), "m/s2", "ground{W}.acceleration",
          "the rate of that during the next step", rate_of="ground_velocity", start=0.0),
    Field("stiffness", "tunable", ("S",), "N/m", "{S}.stiffness",
          "stiffness; of an NSH string: once the NSH has bottomed out", low=0.0),
    Field("damping", "tunable", ("S",), "N.s/m", "{S}.damping", "damping coefficient", low=0.0),
    Field("gravity", "tunable", ("V",), "m/s2", "gravity{V}", "gravity: towards -z, or a vector's component"),
    Field("drag", "tunable", ("R",), "N.s/m", "{R}.drag", "drag coefficient of a node: force per velocity", low=0.0),
    Field("bar_mass", "fixed", ("B",), "kg", "{B}.mass", "mass", low=POSITIVE),
    Field("point_mass", "fixed", ("P",), "kg", "{P}.mass", "mass at a node, beside its bar's", low=0.0),
    Field("string_mass", "fixed", ("M",), "kg", "{M}.mass", "mass, lumped at the string's nodes", low=POSITIVE),
    Field("nsh_Q", "fixed", ("Z",), "N", "{Z}.nsh.Q[{beam}]", "force scale of a beam, eq. 11", low=POSITIVE),
    Field("nsh_zeta", "fixed", ("Z",), "1", "{Z}.nsh.zeta[{beam}]", "shape parameter of a beam, eq. 11", low=POSITIVE),
    Field("nsh_h", "fixed", ("Z",), "m", "{Z}.nsh.h[{beam}]", "height of a beam's arch, eq. 11", low=POSITIVE),
    Field("motor_inertia", "fixed", ("A",), "kg.m2", "{A}.actuator.inertia",
          "moment of inertia J_a of motor and drum, eq. 8", low=POSITIVE),
    Field("motor_damping", "fixed", ("A",), "N.m.s", "{A}.actuator.damping",
          "damping d_a of the motor: torque per speed, eq. 8", low=0.0),
    Field("torque_constant", "fixed", ("A",), "N.m/A", "{A}.actuator.torque_constant",
          "torque k_a per current, eq. 8", low=POSITIVE),
    Field("drum_radius", "fixed", ("A",), "m", "{A}.actuator.radius",
          "radius r of the drum that winds the string in", low=POSITIVE),
    Field("contact_stiffness", "fixed", ("K",), "N/m", "{K}.contact.stiffness",
          "stiffness k_n of the ground under a node", low=POSITIVE),
    Field("contact_damping", "fixed", ("K",), "s/m", "{K}.contact.damping",
          "damping c of the ground: N = k_n delta (1 + c delta')", low=0.0),
    Field("contact_tangential_stiffness", "fixed", ("K",), "N/m", "{K}.contact.tangential_stiffness",
          "stiffness k_t of friction before it slips", low=POSITIVE),
    Field("contact_friction", "fixed", ("K",), "1", "{K}.contact.friction_coefficient",
          "coefficient mu of friction", low=0.0),
    Field("bending_stiffness", "fixed", ("C",), "N.m2", "{C}.bending_stiffness",
          "bending stiffness E I, from which its buckling load follows", low=1e-100),
    Field("strength", "fixed", ("T",), "N", "{T}.strength", "tension that it bears", low=1e-15),
    Field("tolerance", "fixed", (), "1", "solver.tolerance",
          "error per step: relative, and absolute in m and m/s", low=1e-14, high=0.1),
    Field("max_step", "fixed", (), "s", "solver.step",
          "largest step of the integrator, 0: no limit; the step of rk4 and ros2, 0: 1 ms", low=0.0),
    Field("position", "output", ("N", "D"), "m", "{N}.{D}", "node positions", compared="position"),
    Field("velocity", "output", ("F", "D"), "m/s", "{F}.velocity.{D}",
          "velocities of the free nodes", compared="velocity", rate_of="position"),
    Field("string_force", "output", ("S",), "N", "{S}.force", "tension, elastic and damping", compared="force", jumps=True),
    Field("elastic_force", "output", ("S",), "N", "{S}.elastic_force", "elastic tension", compared="force", jumps=True),
    Field("string_length", "output", ("S",), "m", "{S}.length", "length", low=0.0, compared="length"),
    Field("wound_rest_length", "output", ("A",), "m", "{A}.rest_length",
          "rest length of a string with an actuator", compared="length"),
    Field("wound_rest_length_rate", "output", ("A",), "m/s", "{A}.rest_length_rate",
          "its rate", compared="rest length rate", rate_of="wound_rest_length"),
    Field("motor_speed", "output", ("A",), "rad/s", "{A}.actuator.speed",
          "speed at which the motor winds in", compared="motor speed"),
    Field("bar_force", "output", ("B",), "N", "{B}.force",
          "axial force, mean over the bar: -lambda l of eq. 1, tension positive", compared="force", jumps=True),
    Field("reaction", "output", ("G", "D"), "N", "{G}.reaction.{D}",
          "force of the ground on the structure at a fixed node", compared="force", jumps=True),
    Field("contact_normal", "output", ("K",), "N", "{K}.contact.normal",
          "force of the ground on a node along the normal", compared="force", jumps=True),
    Field("contact_force", "output", ("K", "D"), "N", "{K}.contact.friction.{D}",
          "force of friction on it, in the plane", compared="force", jumps=True),
    Field("bar_utilisation", "output", ("C",), "1", "{C}.utilisation",
          "compression over Euler's buckling load pi^2 E I/l^2, 0 in tension", low=0.0, compared="utilisation", jumps=True),
    Field("string_utilisation", "output", ("T",), "1", "{T}.utilisation",
          "tension over strength, 0 where the damper pushes", low=0.0, compared="utilisation", jumps=True),
    Field("kinetic", "output", (), "J", "energy.kinetic", "kinetic energy", low=0.0, compared="energy", jumps=True),
    Field("potential", "output", (), "J", "energy.potential",
          "gravitational potential energy, zero at z = 0", compared="energy"),
    Field("elastic", "output", (), "J", "energy.elastic", "energy stored in the strings", compared="energy", jumps=True),
    Field("dissipated", "output", (), "J", "energy.dissipated",
          "energy lost in dampers, drag, motors and snaps since the start", compared="energy", jumps=True),
    Field("input_work", "output", (), "J", "energy.input_work",
          "work of all inputs and of parameter jumps since the start", compared="energy"),
    Field("throughput", "output", (), "J", "energy.throughput",
          "integral of the sum of |power|, the scale of the energy ledger", compared="scale"),
)

INTEGER_FIELDS = (
    Field("method", "fixed", (), "1", "solver.method", "integration method"),
    Field("snapped", "output", ("H",), "1", "{H}.snapped",
          "beams of an NSH that are past their force maximum", compared="count"),
    Field("contact_sticking", "output", ("K",), "1", "{K}.contact.sticking",
          "1 where a node touches the ground and does not slip, else 0", compared="count"),
)
# fmt: on

#: Integration methods and what they are, in one line each; a method's place is its number in the kernel and in the FMUs.
#: Adding one: its line here, then ``python -m tensegrity_core.fields``, and native/methods/NAME.c with the table `ts_NAME`.
METHOD_MEANINGS = {
    "auto": "explicit, and implicit where the motion is stiff",
    "dop853": "explicit Runge-Kutta method of order 8 by Dormand and Prince",
    "rodas5p": "L-stable Rosenbrock method of order 5",
    "radau9": "L-stable implicit Runge-Kutta method of order 9 (Radau IIA)",
    "rk4": "classical explicit Runge-Kutta method of order 4, fixed step",
    "ros2": "L-stable linearly implicit method of order 2, fixed step and fixed cost: for real time",
    "dopri5": "explicit Runge-Kutta method of order 5 by Dormand and Prince: for short steps",
}
METHODS = tuple(METHOD_MEANINGS)

#: Kinds of force laws, in the order of their numbers in a packed model.
ELEMENTS = ("spring", "beam", "polynomial", "table", "parallel", "series")

#: What a simulation counts.
STATS = ("steps", "rejected", "rhs", "jacobians", "factorisations", "transitions", "restarts", "implicit_steps")

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


def outputs(fields: tuple[Field, ...] = FIELDS + INTEGER_FIELDS) -> tuple[Field, ...]:
    """The fields that are outputs."""
    return tuple(field for field in fields if field.role == "output")


def owned_words() -> frozenset[str]:
    """First words of the variables that a component owns: force of n4.force.x, rest of s1.rest_length, and the axes."""
    found = set("xyz")
    for field in FIELDS + INTEGER_FIELDS:
        owner, _, rest = field.variable.partition(".")
        if owner.startswith("{") and not rest.startswith("{"):
            found.add(rest.replace("[", ".").replace("_", ".").split(".")[0])
    return frozenset(found)


def shared_words() -> frozenset[str]:
    """First words of the variables that no component owns: energy of energy.kinetic, gravity."""
    firsts = (field.variable.partition(".")[0].partition("{")[0] for field in FIELDS + INTEGER_FIELDS)
    return frozenset(filter(None, firsts))


def require_complete(fields: tuple[Field, ...] = FIELDS + INTEGER_FIELDS) -> None:
    """Raises ValueError where a row lacks what is made from it."""
    names = [field.name for field in fields]
    for field in fields:
        if field.role not in ("input", "tunable", "fixed", "output") or not set(field.shape) <= set(COUNTS):
            raise ValueError(f"fields.py: {field.name!r} has the role {field.role!r} and the shape {field.shape!r}; see Field")
        if (field.role == "output") != (field.compared in COMPARED):
            known = ", ".join(COMPARED)
            raise ValueError(
                f"fields.py: {field.name!r}: compared = {field.compared!r}; an output, and nothing else, has one of {known}"
            )
        if names.count(field.name) > 1 or (field.rate_of and field.rate_of not in names):
            raise ValueError(f"fields.py: {field.name!r} stands there twice, or is the rate of an unknown field")


def c_header() -> str:
    """The same list as X-macros for the kernel: native/fields.h."""
    require_complete()
    lines = [
        "/* Written by `python -m tensegrity_core.fields`; edit fields.py instead. */",
        "/* clang-format off */ /* a row is a line */",
        "#ifndef TENSEGRITY_FIELDS_H",
        "#define TENSEGRITY_FIELDS_H",
        "",
        "enum { " + "".join(f"TS_{letter}, " for letter in COUNTS) + "TS_COUNTS }; /* indices of ts_counts() */",
        "enum { " + "".join(f"TS_{name.upper()}, " for name in STATS) + "TS_STATS }; /* of ts_stats() */",
        "enum { TS_ROLE_INPUT, TS_ROLE_TUNABLE, TS_ROLE_FIXED, TS_ROLE_OUTPUT };",
        "enum { " + "".join(f"TS_ELEMENT_{name.upper()}, " for name in ELEMENTS) + "TS_ELEMENTS };",
        "",
    ]
    for macro, prefix, fields in (("TS_FIELDS", "TS_", FIELDS), ("TS_INT_FIELDS", "TS_INT_", INTEGER_FIELDS)):
        lines.append("/* X(name, role, first count, second count, low, high): counts index ts_counts(), -1: none */")
        lines.append(f"#define {macro}(X) \\")
        for field in fields:
            shape = [f"TS_{letter}" for letter in field.shape] + ["-1", "-1"]
            low = "-DBL_MAX" if field.low is None else repr(field.low)
            high = "DBL_MAX" if field.high is None else repr(field.high)
            row = f"    X({prefix}{field.name.upper()}, TS_ROLE_{field.role.upper()}, {shape[0]}, {shape[1]}, {low}, {high})"
            lines.append(f"{row} /* {field.unit}: {field.meaning} */ \\")
        lines.append("")
    lines += [
        "#define TS_NAME(name, role, first, second, low, high) name,",
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
