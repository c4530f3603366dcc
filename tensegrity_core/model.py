"""The model: a scene as frozen arrays, ready to simulate.

A `Model` is what the reference, the kernel and the FMU builder all read.  It holds the start (in equilibrium unless the
scene says otherwise) and the rest lengths that `statics` computed; it knows nothing of files.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .errors import InputError
from .fields import COUNTS, DAMPING_LAWS, FIELDS, METHODS


@dataclass(frozen=True)
class NSH:
    """A negative stiffness honeycomb: beams in series.

    Q: force scale, N; zeta: shape parameter, 1; h: arch height, m; one value per beam, any number of beams >= 1.
    """

    Q: tuple[float, ...]
    zeta: tuple[float, ...]
    h: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """A tensegrity.  Index arrays count nodes from 0 in scene order; SI units; coordinates are always 3D (x, y, z).

    Attributes:
        name: scene name, an identifier.
        description: one line for humans.
        axes: coordinate axes that the scene uses: (0, 1, 2), or two of them in a planar scene.
        node_names, bar_names, string_names: component names.
        nodes: (N, 3) start positions, m.
        fixed: (N,) bool, nodes fixed to the ground.
        bars: (B, 2) int, nodes at the two ends; b = second - first.
        bar_mass: (B,) kg.
        strings: (S, 2) int, nodes at the two ends; s = second - first.
        stiffness: (S,) N/m; of an NSH string: its stiffness once the NSH has bottomed out.
        damping: (S,) N.s/m.
        rest_length: (S,) m.
        nsh: per string its NSH, or None.
        damping_law: 'literal' or 'tension_only'.
        gravity: m/s2, towards -z.
        nominal: (N, 3) node coordinates as the scene file gives them, m; the start differs where it was settled.
        velocity: (N, 3) start velocities, m/s (zero in scenes).
    """

    name: str
    description: str
    axes: tuple[int, ...]
    node_names: tuple[str, ...]
    bar_names: tuple[str, ...]
    string_names: tuple[str, ...]
    nodes: np.ndarray
    fixed: np.ndarray
    bars: np.ndarray
    bar_mass: np.ndarray
    strings: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest_length: np.ndarray
    nsh: tuple[NSH | None, ...]
    damping_law: str
    gravity: float
    nominal: np.ndarray
    velocity: np.ndarray = field(default=None)

    def __post_init__(self):
        if self.velocity is None:
            object.__setattr__(self, "velocity", np.zeros_like(self.nodes, dtype=float))
        for name in ("nodes", "bar_mass", "stiffness", "damping", "rest_length", "nominal", "velocity"):
            self._freeze(name, float)
        for name in ("bars", "strings"):
            self._freeze(name, np.int64, (-1, 2))
        self._freeze("fixed", bool)
        shapes = {"nodes": (self.counts["N"], 3), "nominal": (self.counts["N"], 3), "velocity": (self.counts["N"], 3)}
        shapes |= {"fixed": (self.counts["N"],), "bar_mass": (self.counts["B"],)}
        shapes |= {name: (self.counts["S"],) for name in ("stiffness", "damping", "rest_length")}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"{name} has the shape {getattr(self, name).shape}; give one of shape {shape}")

    def _freeze(self, name: str, dtype, shape=None):
        array = np.array(getattr(self, name), dtype=dtype)
        if shape is not None:
            array = array.reshape(shape)
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @cached_property
    def bar_length(self) -> np.ndarray:
        """(B,) m, from the start positions."""
        return np.linalg.norm(self.nodes[self.bars[:, 1]] - self.nodes[self.bars[:, 0]], axis=1)

    @cached_property
    def free_nodes(self) -> np.ndarray:
        """(F,) indices of the nodes that can move."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def fixed_nodes(self) -> np.ndarray:
        """(G,) indices of the nodes fixed to the ground."""
        return np.flatnonzero(self.fixed)

    @cached_property
    def nsh_strings(self) -> tuple[int, ...]:
        """(H,) indices of the strings that carry an NSH."""
        return tuple(i for i, nsh in enumerate(self.nsh) if nsh is not None)

    @cached_property
    def counts(self) -> dict[str, int]:
        """The counts that `fields.COUNTS` names."""
        return {
            "D": len(self.axes),
            "N": len(self.nodes),
            "F": len(self.free_nodes),
            "G": len(self.fixed_nodes),
            "B": len(self.bars),
            "S": len(self.strings),
            "H": len(self.nsh_strings),
            "Z": sum(len(self.nsh[i].Q) for i in self.nsh_strings),
        }


def _parameters(model: Model, tolerance: float, max_step: float) -> dict[str, np.ndarray]:
    """Start values of all inputs and parameters, by field name."""
    beams = [model.nsh[i] for i in model.nsh_strings]
    return {
        "force": np.zeros(model.counts["F"] * model.counts["D"]),
        "rest_length": model.rest_length,
        "rest_length_rate": np.zeros(len(model.strings)),
        "stiffness": model.stiffness,
        "damping": model.damping,
        "gravity": np.array([model.gravity]),
        "bar_mass": model.bar_mass,
        "nsh_Q": np.array([x for nsh in beams for x in nsh.Q]),
        "nsh_zeta": np.array([x for nsh in beams for x in nsh.zeta]),
        "nsh_h": np.array([x for nsh in beams for x in nsh.h]),
        "tolerance": np.array([tolerance]),
        "max_step": np.array([max_step]),
    }


def fnv1a(data: bytes) -> int:
    """64-bit FNV-1a hash, as the kernel computes it."""
    value = 14695981039346656037
    for byte in data:
        value = ((value ^ byte) * 1099511628211) & 0xFFFFFFFFFFFFFFFF
    return value


def to_bytes(model: Model, method: str = "auto", tolerance: float = 1e-10, max_step: float = 0.0) -> bytes:
    """The model as the packed bytes that the kernel reads; the layout stands in native/model.c.

    method, tolerance, max_step: defaults of the fields of these names.
    """
    axes = list(model.axes)
    counts = [model.counts[letter] for letter in COUNTS]
    z_axis = axes.index(2) if 2 in axes else -1
    beams = [len(nsh.Q) if nsh is not None else 0 for nsh in model.nsh]
    header = [*counts, DAMPING_LAWS.index(model.damping_law), METHODS.index(method), z_axis, 0]
    ints = [*header, *model.fixed.astype(int), *model.bars.ravel(), *model.strings.ravel(), *beams]
    ints += [0] * (len(ints) % 2)
    start = _parameters(model, tolerance, max_step)
    doubles = [model.nodes[:, axes].ravel(), model.velocity[:, axes].ravel()]
    doubles += [start[field.name] for field in FIELDS if field.role != "output"]
    body = b"TSMODEL1" + np.array(ints, "<i4").tobytes() + np.concatenate(doubles).astype("<f8").tobytes()
    return body + fnv1a(body).to_bytes(8, "little")
