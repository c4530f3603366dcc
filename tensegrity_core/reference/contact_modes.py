"""What a contact with the ground does next: apart, sticking, slipping or clipped."""

from __future__ import annotations

import numpy as np

from .contact import APART, CLIPPED, SLIPPING, STICKING, Contacts, Slipping, Touching

#: Gaps (see `Contacts.gaps`: m; 1; m, or m/s) below which contacts change together, and those that are zero to round-off.
TOGETHER = np.array([1e-13, 1e-11, 1e-12])
ROUND_OFF = np.array([1e-15, 1e-13, 1e-14])
#: Rates (m/s) below which accelerations decide.
AT_REST = 1e-15


def entered(contacts: Contacts, i: int, touching: Touching, slipping: Slipping) -> int:
    """The mode of contact i once the ground begins to press on it, u being 0: which of v_t and mu N / k_t grows faster; where
    neither does, which of their rates."""
    if contacts.mu[i] == 0.0:
        return SLIPPING
    slide, reach = float(np.linalg.norm(touching.slide[:, i])), slipping.reach[i]
    if max(slide, abs(reach)) <= AT_REST:
        slide = float(np.linalg.norm(slipping.slide_acceleration[:, i]))
        reach = contacts.limit[i] * contacts.k[i] * slipping.depth_acceleration[i]
    return STICKING if slide <= reach else SLIPPING


def changed(contacts: Contacts, change: np.ndarray, touching: Touching, slipping: Slipping) -> np.ndarray:
    """(K,) the modes once the gaps of `change` (3, K) have closed.

    Where a node leaves the ground or is clipped, its friction vanishes with N, and it does not slip before.
    """
    gap, mode = contacts.gaps(touching, slipping), touching.mode.copy()
    leaving = change[0] | ((gap[0] <= TOGETHER[0]) & (touching.rate < 0.0))
    closing = change[1] | (gap[1] <= TOGETHER[1])
    for i in np.flatnonzero(change.any(axis=0)).tolist():
        if mode[i] == APART:
            mode[i] = entered(contacts, i, touching, slipping)
        elif leaving[i]:
            mode[i] = APART
        elif mode[i] == CLIPPED:
            mode[i] = entered(contacts, i, touching, slipping)
        elif closing[i]:
            mode[i] = CLIPPED
        else:
            mode[i] = SLIPPING if mode[i] == STICKING else STICKING
    return mode


def pressed(contacts: Contacts, touching: Touching, slipping: Slipping) -> np.ndarray:
    """(K,) the modes at the start, or after a jump of inputs, before friction is looked at: what has not touched sticks.

    A node in the plane goes where its rate leads, or its acceleration if it is at rest.
    """
    depth, rate, near = touching.depth, touching.rate, TOGETHER[0]
    leads = np.where(np.abs(rate) < AT_REST, slipping.depth_acceleration, rate)
    presses = (depth > near) | ((depth >= -near) & (leads > 0.0))
    pushes = ~contacts.clips | (1.0 + contacts.c * rate > 0.0)
    new = (touching.mode == APART) | (touching.mode == CLIPPED)
    mode = np.where(new, np.where(contacts.mu > 0.0, STICKING, SLIPPING), touching.mode)
    mode = np.where(presses, np.where(pushes, mode, CLIPPED), APART)
    for i in np.flatnonzero(presses & pushes & (depth <= near)).tolist():
        mode[i] = entered(contacts, i, touching, slipping)
    return mode


def bristles(before: np.ndarray, after: np.ndarray, touching: Touching) -> np.ndarray:
    """(d, K) u as it belongs to the modes after: 0 where nothing presses, or where pressing begins.  touching: u is on its cone
    there."""
    none = np.isin(before, (APART, CLIPPED)) | np.isin(after, (APART, CLIPPED))
    return np.where(none, 0.0, touching.bristle)
