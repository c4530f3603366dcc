/* Written by `python -m tensegrity_core.fields`; edit fields.py instead. */
/* clang-format off */ /* a row is a line */
#ifndef TENSEGRITY_FIELDS_H
#define TENSEGRITY_FIELDS_H

enum { TS_D, TS_N, TS_F, TS_G, TS_B, TS_S, TS_H, TS_Z, TS_V, TS_P, TS_R, TS_E, TS_A, TS_K, TS_W, TS_M, TS_C, TS_T, TS_COUNTS }; /* indices of ts_counts() */
enum { TS_STEPS, TS_REJECTED, TS_RHS, TS_JACOBIANS, TS_FACTORISATIONS, TS_TRANSITIONS, TS_RESTARTS, TS_IMPLICIT_STEPS, TS_STATS }; /* of ts_stats() */
enum { TS_ROLE_INPUT, TS_ROLE_TUNABLE, TS_ROLE_FIXED, TS_ROLE_OUTPUT };
enum { TS_ELEMENT_SPRING, TS_ELEMENT_BEAM, TS_ELEMENT_POLYNOMIAL, TS_ELEMENT_TABLE, TS_ELEMENT_PARALLEL, TS_ELEMENT_SERIES, TS_ELEMENTS };

/* X(name, role, first count, second count, low, high): counts index ts_counts(), -1: none */
#define TS_FIELDS(X) \
    X(TS_FORCE, TS_ROLE_INPUT, TS_F, TS_D, -DBL_MAX, DBL_MAX) /* N: external force on a free node, held over a step */ \
    X(TS_REST_LENGTH, TS_ROLE_INPUT, TS_S, -1, 0.0, DBL_MAX) /* m: rest length at the start of the next step */ \
    X(TS_REST_LENGTH_RATE, TS_ROLE_INPUT, TS_S, -1, -DBL_MAX, DBL_MAX) /* m/s: rate of the rest length during the next step */ \
    X(TS_CURRENT, TS_ROLE_INPUT, TS_A, -1, -DBL_MAX, DBL_MAX) /* A: current of an actuator's motor, held over a step */ \
    X(TS_DRUM_LOAD, TS_ROLE_INPUT, TS_A, -1, -DBL_MAX, DBL_MAX) /* N: pull on an actuator's drum beside its string's tension */ \
    X(TS_NODE_POSITION, TS_ROLE_INPUT, TS_E, TS_D, -DBL_MAX, DBL_MAX) /* m: position of a moved node at the start of the next step */ \
    X(TS_NODE_VELOCITY, TS_ROLE_INPUT, TS_E, TS_D, -DBL_MAX, DBL_MAX) /* m/s: its velocity then */ \
    X(TS_NODE_ACCELERATION, TS_ROLE_INPUT, TS_E, TS_D, -DBL_MAX, DBL_MAX) /* m/s2: its acceleration during the next step */ \
    X(TS_GROUND_HEIGHT, TS_ROLE_INPUT, TS_W, -1, -DBL_MAX, DBL_MAX) /* m: height of the ground along its normal at the start of the next step */ \
    X(TS_GROUND_VELOCITY, TS_ROLE_INPUT, TS_W, -1, -DBL_MAX, DBL_MAX) /* m/s: its rate then */ \
    X(TS_GROUND_ACCELERATION, TS_ROLE_INPUT, TS_W, -1, -DBL_MAX, DBL_MAX) /* m/s2: the rate of that during the next step */ \
    X(TS_STIFFNESS, TS_ROLE_TUNABLE, TS_S, -1, 0.0, DBL_MAX) /* N/m: stiffness; of an NSH string: once the NSH has bottomed out */ \
    X(TS_DAMPING, TS_ROLE_TUNABLE, TS_S, -1, 0.0, DBL_MAX) /* N.s/m: damping coefficient */ \
    X(TS_GRAVITY, TS_ROLE_TUNABLE, TS_V, -1, -DBL_MAX, DBL_MAX) /* m/s2: gravity: towards -z, or a vector's component */ \
    X(TS_DRAG, TS_ROLE_TUNABLE, TS_R, -1, 0.0, DBL_MAX) /* N.s/m: drag coefficient of a node: force per velocity */ \
    X(TS_BAR_MASS, TS_ROLE_FIXED, TS_B, -1, 2.2250738585072014e-308, DBL_MAX) /* kg: mass */ \
    X(TS_POINT_MASS, TS_ROLE_FIXED, TS_P, -1, 0.0, DBL_MAX) /* kg: mass at a node, beside its bar's */ \
    X(TS_STRING_MASS, TS_ROLE_FIXED, TS_M, -1, 2.2250738585072014e-308, DBL_MAX) /* kg: mass, lumped at the string's nodes */ \
    X(TS_NSH_Q, TS_ROLE_FIXED, TS_Z, -1, 2.2250738585072014e-308, DBL_MAX) /* N: force scale of a beam, eq. 11 */ \
    X(TS_NSH_ZETA, TS_ROLE_FIXED, TS_Z, -1, 2.2250738585072014e-308, DBL_MAX) /* 1: shape parameter of a beam, eq. 11 */ \
    X(TS_NSH_H, TS_ROLE_FIXED, TS_Z, -1, 2.2250738585072014e-308, DBL_MAX) /* m: height of a beam's arch, eq. 11 */ \
    X(TS_MOTOR_INERTIA, TS_ROLE_FIXED, TS_A, -1, 2.2250738585072014e-308, DBL_MAX) /* kg.m2: moment of inertia J_a of motor and drum, eq. 8 */ \
    X(TS_MOTOR_DAMPING, TS_ROLE_FIXED, TS_A, -1, 0.0, DBL_MAX) /* N.m.s: damping d_a of the motor: torque per speed, eq. 8 */ \
    X(TS_TORQUE_CONSTANT, TS_ROLE_FIXED, TS_A, -1, 2.2250738585072014e-308, DBL_MAX) /* N.m/A: torque k_a per current, eq. 8 */ \
    X(TS_DRUM_RADIUS, TS_ROLE_FIXED, TS_A, -1, 2.2250738585072014e-308, DBL_MAX) /* m: radius r of the drum that winds the string in */ \
    X(TS_CONTACT_STIFFNESS, TS_ROLE_FIXED, TS_K, -1, 2.2250738585072014e-308, DBL_MAX) /* N/m: stiffness k_n of the ground under a node */ \
    X(TS_CONTACT_DAMPING, TS_ROLE_FIXED, TS_K, -1, 0.0, DBL_MAX) /* s/m: damping c of the ground: N = k_n delta (1 + c delta') */ \
    X(TS_CONTACT_TANGENTIAL_STIFFNESS, TS_ROLE_FIXED, TS_K, -1, 2.2250738585072014e-308, DBL_MAX) /* N/m: stiffness k_t of friction before it slips */ \
    X(TS_CONTACT_FRICTION, TS_ROLE_FIXED, TS_K, -1, 0.0, DBL_MAX) /* 1: coefficient mu of friction */ \
    X(TS_BENDING_STIFFNESS, TS_ROLE_FIXED, TS_C, -1, 1e-100, DBL_MAX) /* N.m2: bending stiffness E I, from which its buckling load follows */ \
    X(TS_STRENGTH, TS_ROLE_FIXED, TS_T, -1, 1e-15, DBL_MAX) /* N: tension that it bears */ \
    X(TS_TOLERANCE, TS_ROLE_FIXED, -1, -1, 1e-14, 0.1) /* 1: error per step: relative, and absolute in m and m/s */ \
    X(TS_MAX_STEP, TS_ROLE_FIXED, -1, -1, 0.0, DBL_MAX) /* s: largest step of the integrator, 0: no limit; the step of rk4 and ros2, 0: 1 ms */ \
    X(TS_POSITION, TS_ROLE_OUTPUT, TS_N, TS_D, -DBL_MAX, DBL_MAX) /* m: node positions */ \
    X(TS_VELOCITY, TS_ROLE_OUTPUT, TS_F, TS_D, -DBL_MAX, DBL_MAX) /* m/s: velocities of the free nodes */ \
    X(TS_STRING_FORCE, TS_ROLE_OUTPUT, TS_S, -1, -DBL_MAX, DBL_MAX) /* N: tension, elastic and damping */ \
    X(TS_ELASTIC_FORCE, TS_ROLE_OUTPUT, TS_S, -1, -DBL_MAX, DBL_MAX) /* N: elastic tension */ \
    X(TS_STRING_LENGTH, TS_ROLE_OUTPUT, TS_S, -1, 0.0, DBL_MAX) /* m: length */ \
    X(TS_WOUND_REST_LENGTH, TS_ROLE_OUTPUT, TS_A, -1, -DBL_MAX, DBL_MAX) /* m: rest length of a string with an actuator */ \
    X(TS_WOUND_REST_LENGTH_RATE, TS_ROLE_OUTPUT, TS_A, -1, -DBL_MAX, DBL_MAX) /* m/s: its rate */ \
    X(TS_MOTOR_SPEED, TS_ROLE_OUTPUT, TS_A, -1, -DBL_MAX, DBL_MAX) /* rad/s: speed at which the motor winds in */ \
    X(TS_BAR_FORCE, TS_ROLE_OUTPUT, TS_B, -1, -DBL_MAX, DBL_MAX) /* N: axial force, mean over the bar: -lambda l of eq. 1, tension positive */ \
    X(TS_REACTION, TS_ROLE_OUTPUT, TS_G, TS_D, -DBL_MAX, DBL_MAX) /* N: force of the ground on the structure at a fixed node */ \
    X(TS_CONTACT_NORMAL, TS_ROLE_OUTPUT, TS_K, -1, -DBL_MAX, DBL_MAX) /* N: force of the ground on a node along the normal */ \
    X(TS_CONTACT_FORCE, TS_ROLE_OUTPUT, TS_K, TS_D, -DBL_MAX, DBL_MAX) /* N: force of friction on it, in the plane */ \
    X(TS_BAR_UTILISATION, TS_ROLE_OUTPUT, TS_C, -1, 0.0, DBL_MAX) /* 1: compression over Euler's buckling load pi^2 E I/l^2, 0 in tension */ \
    X(TS_STRING_UTILISATION, TS_ROLE_OUTPUT, TS_T, -1, 0.0, DBL_MAX) /* 1: tension over strength, 0 where the damper pushes */ \
    X(TS_KINETIC, TS_ROLE_OUTPUT, -1, -1, 0.0, DBL_MAX) /* J: kinetic energy */ \
    X(TS_POTENTIAL, TS_ROLE_OUTPUT, -1, -1, -DBL_MAX, DBL_MAX) /* J: gravitational potential energy, zero at z = 0 */ \
    X(TS_ELASTIC, TS_ROLE_OUTPUT, -1, -1, -DBL_MAX, DBL_MAX) /* J: energy stored in the strings */ \
    X(TS_DISSIPATED, TS_ROLE_OUTPUT, -1, -1, -DBL_MAX, DBL_MAX) /* J: energy lost in dampers, drag, motors and snaps since the start */ \
    X(TS_INPUT_WORK, TS_ROLE_OUTPUT, -1, -1, -DBL_MAX, DBL_MAX) /* J: work of all inputs and of parameter jumps since the start */ \
    X(TS_THROUGHPUT, TS_ROLE_OUTPUT, -1, -1, -DBL_MAX, DBL_MAX) /* J: integral of the sum of |power|, the scale of the energy ledger */ \

/* X(name, role, first count, second count, low, high): counts index ts_counts(), -1: none */
#define TS_INT_FIELDS(X) \
    X(TS_INT_METHOD, TS_ROLE_FIXED, -1, -1, -DBL_MAX, DBL_MAX) /* 1: integration method */ \
    X(TS_INT_SNAPPED, TS_ROLE_OUTPUT, TS_H, -1, -DBL_MAX, DBL_MAX) /* 1: beams of an NSH that are past their force maximum */ \
    X(TS_INT_CONTACT_STICKING, TS_ROLE_OUTPUT, TS_K, -1, -DBL_MAX, DBL_MAX) /* 1: 1 where a node touches the ground and does not slip, else 0 */ \

#define TS_NAME(name, role, first, second, low, high) name,
enum { TS_FIELDS(TS_NAME) TS_FIELD_COUNT };
enum { TS_INT_FIELDS(TS_NAME) TS_INT_FIELD_COUNT };
#undef TS_NAME

enum { TS_METHOD_AUTO, TS_METHOD_DOP853, TS_METHOD_RODAS5P, TS_METHOD_RADAU9, TS_METHOD_RK4, TS_METHOD_ROS2, TS_METHOD_DOPRI5, TS_METHOD_COUNT };
#define TS_METHODS(X) X(DOP853, dop853) X(RODAS5P, rodas5p) X(RADAU9, radau9) X(RK4, rk4) X(ROS2, ros2) X(DOPRI5, dopri5)
enum { TS_LITERAL, TS_TENSION_ONLY };

#endif
