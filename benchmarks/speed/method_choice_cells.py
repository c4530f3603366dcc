"""The cells over which `auto` is judged: a model, a drive, a duration, communication steps and a tolerance.

`drawn` takes them out of a product of choices that users make; `anywhere` draws every number from a range, so that nothing can
have been tuned to it; `ladders` are the same problem at falling tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tensegrity_core.kernel import input_rows
from tensegrity_core.model import NSH, Model, held
from tensegrity_core.scene import load_scene
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model

SCENES = ("two_bar", "three_bar", "six_bar", "two_bar_nsh", "three_bar_nsh", "six_bar_nsh", "tower")
#: Stages of three bars of the tower.
STAGES = 10
DAMPINGS = (50.0, 500.0, 5000.0)
DRIVES = ("constant", "square", "rest lengths", "release", "random")
#: Time between changes of the inputs of each drive, s; None: they stay.
CHANGES = {"lift": None, "constant": None, "release": None, "square": 0.5, "rest lengths": 0.01, "random": 0.05}
DURATIONS = (0.1, 5.0, 50.0)
#: Communication steps, s; 0: none, a call lasts until the inputs change.
CALLS = (0.0, 1e-3, 1e-2)
TOLERANCES = tuple(10.0**-n for n in range(4, 13))
#: Numbers in the table of inputs of a cell.
MOST_NUMBERS = 10_000_000


@dataclass(frozen=True)
class Cell:
    """scene: of SCENES, or 'any', a tower with everything drawn; memory: NSHs have one; damping: N s/m, of every string;
    drive: of CHANGES; duration, call: s; tolerance: relative, and absolute in m and m/s; seed: of what is drawn."""

    scene: str
    memory: bool
    damping: float
    drive: str
    duration: float
    call: float
    tolerance: float
    seed: int

    @property
    def name(self) -> str:
        law = " with memory" if self.memory else ""
        call = f"calls of {1e3 * self.call:.3g} ms" if self.call else "one call"
        return f"{self.scene}{law}, d = {self.damping:.4g}, {self.drive}, {self.duration:.3g} s, {call}, {self.tolerance:.1e}"


@cache
def built_in(scene: str) -> Model:
    return build_model(tower(STAGES) if scene == "tower" else load_scene(scene))


def any_tower(seed: int) -> Model:
    """A tower of one to three stages, plain or with NSHs, of any stiffness, mass and prestress."""
    random = np.random.default_rng(seed)
    stages, nsh = int(random.integers(1, 4)), bool(random.random() < 0.4)
    options = {"stiffness": 10.0 ** random.uniform(3.0, 5.0), "mass": 10.0 ** random.uniform(-1.0, 1.0), "gravity": 0.0}
    if stages > 1:
        options["tension"] = random.uniform(20.0, 60.0)
    else:
        options["gravity"] = random.uniform(2.0, 12.0)
    return build_model(tower(stages, nsh, **options))


def model_of(cell: Cell, released: float) -> Model:
    """released: part of the rest lengths that is taken away at once."""
    model = any_tower(cell.seed) if cell.scene == "any" else built_in(cell.scene)
    nsh = tuple(NSH(n.Q, n.zeta, n.h, "hysteretic") if cell.memory and n else n for n in model.nsh)
    damping = np.full(len(model.strings), cell.damping)
    return replace(model, damping=damping, nsh=nsh, rest_length=model.rest_length * (1.0 - released))


def signals(cell: Cell, model: Model, random: np.random.Generator) -> dict:
    """What `held` samples: forces and rest lengths over time."""
    free = np.flatnonzero(~model.fixed)
    force = np.zeros((len(model.nodes), 3))
    if cell.drive == "lift":
        force[model.node_names.index("n4"), 2] = 45.0
        return {"force": lambda t: force}
    if cell.drive in ("constant", "square"):
        force[random.choice(free), 2] = random.uniform(*((10.0, 60.0) if cell.drive == "constant" else (50.0, 400.0)))
        if random.random() < 0.5:
            force[free, model.axes[0]] += random.uniform(-20.0, 20.0, len(free))
        half = CHANGES["square"]
        return {"force": lambda t: force if cell.drive == "constant" or t % (2.0 * half) < half else -force}
    if cell.drive == "rest lengths":
        moved = random.random(len(model.strings)) < 0.4
        size, period = random.uniform(0.01, 0.1), random.uniform(0.5, 3.0)
        return {"rest_length": lambda t: model.rest_length * (1.0 + size * moved * (1.0 - np.cos(2.0 * np.pi * t / period)))}
    if cell.drive == "random":
        count = int(cell.duration / CHANGES["random"]) + 2
        draws = random.normal(scale=random.uniform(5.0, 50.0), size=(count, len(model.nodes), 3)) * ~model.fixed[:, None]
        return {"force": lambda t: draws[int(t / CHANGES["random"])]}
    return {}


def built(cell: Cell) -> tuple[Model, np.ndarray, np.ndarray]:
    """The model of a cell, its calls' lengths (K,), s, and the kernel's inputs (rows, inputs) before each of them; the last row
    stays."""
    random = np.random.default_rng(cell.seed)
    model = model_of(cell, random.uniform(0.002, 0.02) if cell.drive == "release" else 0.0)
    change = CHANGES[cell.drive] or cell.duration
    count = max(1, round(cell.duration / (cell.call or min(change, cell.duration))))
    times = np.arange(count + 1) * cell.duration / count
    inputs = held(model, times if CHANGES[cell.drive] else times[:2], **signals(cell, model, random))
    return model, np.diff(times), np.ascontiguousarray(input_rows(model, inputs))


def affordable(cell: Cell) -> bool:
    """Whether its inputs fit, and a memory has something to remember."""
    if cell.memory and not cell.scene.endswith("_nsh"):
        return False
    if not CHANGES[cell.drive]:
        return True
    strings = {"two_bar": 3, "three_bar": 6, "six_bar": 21, "tower": 141, "any": 40}[cell.scene.removesuffix("_nsh")]
    return cell.duration / (cell.call or CHANGES[cell.drive]) * 4.0 * strings < MOST_NUMBERS


def every() -> list[Cell]:
    """The whole product."""
    cells = (
        Cell(scene, memory, damping, drive, duration, call, tolerance, 0)
        for scene in SCENES
        for memory in (False, True)
        for damping in DAMPINGS
        for drive in DRIVES
        for duration in DURATIONS
        for call in CALLS
        for tolerance in TOLERANCES
    )
    return [replace(cell, seed=n) for n, cell in enumerate(cells) if affordable(cell)]


def drawn(count: int, seed: int) -> list[Cell]:
    """Cells out of the product, each with the same chance."""
    cells = every()
    return [cells[i] for i in np.random.default_rng(seed).permutation(len(cells))[:count]]


def anywhere(count: int, seed: int) -> list[Cell]:
    """Cells with every number from a range: damping 10 ... 10^4 N s/m, 0.05 ... 20 s, calls of 0.3 ... 50 ms or one, tolerances
    10^-4 ... 10^-12."""
    random, found = np.random.default_rng(seed), []
    while len(found) < count:
        call = 10.0 ** random.uniform(-3.5, -1.3) if random.random() < 0.6 else 0.0
        ranges = random.uniform(1.0, 4.0), random.uniform(-1.3, 1.3), random.uniform(-12.0, -4.0)
        damping, duration, tolerance = (float(10.0**value) for value in ranges)
        cell = Cell("any", False, damping, str(random.choice(DRIVES)), duration, call, tolerance, int(random.integers(2**31)))
        if affordable(cell):
            found.append(cell)
    return found


def ladders() -> list[list[Cell]]:
    """The six scenes under a lift of one node, each at every tolerance, from the loosest on."""
    return [[Cell(s, False, d, "lift", 5.0, 0.0, t, 0) for t in TOLERANCES] for s in SCENES[:-1] for d in DAMPINGS]
