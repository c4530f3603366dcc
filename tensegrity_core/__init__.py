"""Tensegrity dynamics with negative stiffness honeycombs (NSH).

One model, two independent implementations: `tensegrity_core.reference` holds the matrix equations in NumPy, integrated
by SciPy; `tensegrity_core.kernel` drives the C kernel.  They share scene data (`tensegrity_core.model`) and nothing else.
"""

__version__ = "0.1.0"
