"""From a scene to a model: prestress, rest lengths, settling, states of self-stress, stability."""

from __future__ import annotations

from .analysis import analyse, rigid_body_motions, rigid_fields
from .balance import Balance
from .forces import equilibrium_matrix, loads, member_forces, residual, unbalanced
from .ground import depths, ground_loads, pressures
from .jointed import balance_of
from .matrices import Dense, TooLarge, free_rows, freedoms, in_space, lengths_between, null_space, require_small, shortest_bar
from .members import members, places
from .settling import NoEquilibrium, descend, settle
from .start import build_model
from .strings import string_branches, string_energy, string_tension
from .surface import NEUTRAL, Modes, Surface, SurfacePoint, is_stable, stability, step_limit, tangent_stiffness

__all__ = [
    "NEUTRAL",
    "Balance",
    "Dense",
    "Modes",
    "NoEquilibrium",
    "Surface",
    "SurfacePoint",
    "TooLarge",
    "analyse",
    "balance_of",
    "build_model",
    "depths",
    "descend",
    "equilibrium_matrix",
    "free_rows",
    "freedoms",
    "ground_loads",
    "in_space",
    "is_stable",
    "lengths_between",
    "loads",
    "member_forces",
    "members",
    "null_space",
    "places",
    "pressures",
    "require_small",
    "residual",
    "rigid_body_motions",
    "rigid_fields",
    "settle",
    "shortest_bar",
    "stability",
    "step_limit",
    "string_branches",
    "string_energy",
    "string_tension",
    "tangent_stiffness",
    "unbalanced",
]
