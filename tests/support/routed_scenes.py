"""Random structures whose strings run over several nodes, have mass, or push: any model's strings, made so."""

from __future__ import annotations

import dataclasses

import numpy as np

from tensegrity_core.model import Model


def routed(model: Model, seed: int) -> Model:
    """The model with further nodes on the way of some strings (fixed ones too, some strings endless), masses of some, and some
    plain springs that push; rest lengths are near the new lengths."""
    random = np.random.default_rng(seed + 2 * 10**6)
    routes, count = [], len(model.nodes)
    for string, ends in enumerate(model.strings.tolist()):
        path = list(ends)
        for _ in range(int(random.integers(0, 4))):
            path.append(int(random.choice([node for node in range(count) if node != path[-1]])))
        if len(set(path)) > 2 and path[-1] != path[0] and random.random() < 0.3:
            path.append(path[0])  # endless
        if len(path) > 2 and (path[0] != path[-1] or len(set(path)) > 2):
            routes.append((string, tuple(path)))
    strings = len(model.strings)
    plain = np.array([nsh is None and one is None for nsh, one in zip(model.nsh, model.element)], dtype=bool)
    changed = dataclasses.replace(
        model,
        routes=tuple(routes),
        string_mass=np.where(random.random(strings) < 0.5, random.uniform(0.02, 0.8, strings), 0.0),
        two_way=plain & (random.random(strings) < 0.4),
    )
    length = changed.string_lengths(model.nodes)
    return dataclasses.replace(changed, rest_length=length * random.uniform(0.85, 1.02, strings))
