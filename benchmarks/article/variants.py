"""What the article leaves open, each choice settled another way: the variants under which docs/claims.md judges its claims.

A variant maps a system's model to the model that is run; of II it also says how the wave starts, of IV it has the oscillator's
numbers.  Here is also the NSH's law with the string's own stiffness in series, without and with memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tensegrity_core import statics
from tensegrity_core.article import experiments
from tensegrity_core.kernel import simulate
from tensegrity_core.laws import law, string_law
from tensegrity_core.model import Model, held
from tensegrity_core.model.elements import Series, Spring
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

#: How long a changed structure settles, s, before a wave.
SETTLING = 30.0


@dataclass(frozen=True)
class Variant:
    """key: an identifier; about: what is chosen otherwise; change(model) -> model; scale(tensions of the scene) -> tensions;
    phase: of the wave, periods; damping: factor of every d in II; oscillator: arguments of experiments.experiment_4."""

    key: str
    about: str
    change: Callable[[Model], Model] = lambda model: model
    scale: Callable[[dict], dict] | None = None
    phase: float = 0.0
    damping: float = 1.0
    oscillator: dict = field(default_factory=dict)

    def model(self, name: str) -> Model:
        """A built-in scene's model under this choice."""
        scene = load_scene(name)
        if self.scale:
            prestress = scene.prestress.model_copy(update={"tension": self.scale(scene.prestress.tension)})
            scene = scene.model_copy(update={"prestress": prestress})
        return self.change(build_model(scene))


def at_nsh_strings(name: str, factor: float | None = None, value: float | None = None) -> Callable[[Model], Model]:
    """Changes a field of the NSH strings: by a factor, or to a value."""

    def change(model: Model) -> Model:
        values = getattr(model, name).copy()
        chosen = list(model.nsh_strings)
        values[chosen] = values[chosen] * factor if value is None else value
        return replace(model, **{name: values})

    return change


def end_stiffness(model: Model) -> Model:
    """Beyond its end the NSH goes on with the slope that it has there: a table extrapolated by its last pair."""
    changed = model
    for i in model.nsh_strings:
        made = law(model.nsh[i].element)
        stiffness = changed.stiffness.copy()
        stiffness[i] = made.stiffness(made.end)
        changed = replace(changed, stiffness=stiffness)
    return changed


def lengths(model: Model) -> np.ndarray:
    """(S,) m, at the start."""
    return model.string_lengths(model.nodes)


def in_series(law: str) -> Callable[[Model], Model]:
    """The string's own stiffness k in series with its NSH, which has the law 'single_valued' or 'hysteretic'.

    The single-valued one is an element of a spring and the beams; the law with memory has k in series anyway.  Each string
    bears at the start what it bore before, so the start stays in equilibrium.
    """

    def change(model: Model) -> Model:
        honeycombs, elements = list(model.nsh), list(model.element)
        for i in model.nsh_strings:
            if law == "hysteretic":
                honeycombs[i] = replace(honeycombs[i], law=law)
            else:
                elements[i] = Series((Spring(float(model.stiffness[i])), *honeycombs[i].element.parts), law)
                honeycombs[i] = None
        changed, length = replace(model, nsh=tuple(honeycombs), element=tuple(elements)), lengths(model)
        tension, rest_length = statics.string_tension(model, length), model.rest_length.copy()
        for i in model.nsh_strings:
            rest_length[i] = length[i] - string_law(changed, i).elongation(tension.item(i))
        return replace(changed, rest_length=rest_length)

    return change


def weightless(model: Model) -> Model:
    """No gravity and no tension at the start: the one equilibrium that the coordinates allow then."""
    return replace(model, gravity=0.0, rest_length=lengths(model))


def printed_inertia(model: Model) -> Model:
    """J_i = m_i l_i^2/12 in M, as the article prints it, for bars that are pinned at an end.

    Such a bar's M about its pin is m/4 + J instead of m/4 + m/12, so the motion is that of a bar of 3 (1/4 + l^2/12) times
    the mass under the same weight.
    """
    pinned = model.fixed[model.bars].any(axis=1)
    if not pinned.all() or np.ptp(model.bar_length) > 1e-3:
        raise ValueError(f"{model.name}: the bars are not all pinned and of one length")
    factor = 3.0 * (0.25 + float(np.mean(model.bar_length)) ** 2 / 12.0)
    return replace(model, bar_mass=factor * model.bar_mass, gravity=model.gravity / factor)


def beside(model: Model) -> Model:
    """The NSH in parallel with the plain string, which carries nothing at the start."""
    chosen = list(model.nsh_strings)
    plain = float(np.delete(model.stiffness, chosen)[0]) if chosen else 0.0
    added = {"stiffness": np.full(len(chosen), plain), "damping": np.zeros(len(chosen)), "rest_length": lengths(model)[chosen]}
    none = (None,) * len(chosen)
    return replace(
        model,
        strings=np.concatenate((model.strings, model.strings[chosen])),
        string_names=(*model.string_names, *(f"{model.string_names[i]}_beside" for i in chosen)),
        nsh=(*model.nsh, *none),
        element=(*model.element, *none),
        damper=(*model.damper, *none),
        actuator=(*model.actuator, *none),
        **{name: np.concatenate((getattr(model, name), values)) for name, values in added.items()},
    )


def shortened(metres: float, top: bool) -> Callable[[Model], Model]:
    """Rest lengths of the top or of the other strings shortened, and the structure let settle before the run."""

    def change(model: Model) -> Model:
        chosen = experiments.top_strings(model) == top
        tight = replace(model, rest_length=model.rest_length - metres * chosen)
        rest = simulate(tight, held(tight, np.array([0.0, SETTLING])))
        return replace(tight, nodes=rest.position[-1])

    return change


def tension_only(model: Model) -> Model:
    return replace(model, damping_law="tension_only")


def top_tension(value: float) -> Callable[[dict], dict]:
    """Of the two-bar system's top string, N; other scenes as they are."""
    return lambda tension: {"s3": value} if set(tension) == {"s3"} else tension


def level(factor: float) -> Callable[[dict], dict]:
    """Of the six-bar system's tensions; other scenes as they are."""
    return lambda tension: {k: factor * v for k, v in tension.items()} if len(tension) == 21 else tension


# --- the variants ---------------------------------------------------------------------------------------------

BASE = Variant("base", "this model")
LAW = Variant("tension_only", "dampers never push (`tension_only`)", tension_only)
BEYOND = (
    Variant("hold", "beyond 9 cm the force stays at 48 N", at_nsh_strings("stiffness", value=0.0)),
    Variant("end_slope", "beyond 9 cm the curve goes on with its last slope, 16.8 kN/m", end_stiffness),
    Variant("ten_k", "beyond 9 cm ten times the stiffness k", at_nsh_strings("stiffness", factor=10.0)),
)
DAMPERS = (
    Variant("tenth", "NSH strings with a tenth of the damping", at_nsh_strings("damping", factor=0.1)),
    Variant("undamped", "NSH strings without damper", at_nsh_strings("damping", value=0.0)),
)
PRESTRESS = (
    *(
        Variant(f"top_{t:g}", f"two-bar: {t:g} N in the top string", scale=top_tension(t))
        for t in (6.0, 15.0, 20.0, 30.0, 40.0)
    ),
    *(
        Variant(f"level_{f:g}".replace(".", "_"), f"six-bar: {f:g} times the prestress", scale=level(f))
        for f in (0.1, 0.25, 0.5, 1.5, 2.0, 3.0)
    ),
)
PHASES = (
    Variant("down", "the wave starts with -400 N", phase=0.5),
    Variant("quarter", "the wave starts in the middle of its +400 N", phase=0.25),
    Variant("three_quarters", "the wave starts in the middle of its -400 N", phase=0.75),
)
GRAVITY = (
    Variant("no_gravity", "no gravity, rest lengths as they are", lambda model: replace(model, gravity=0.0)),
    Variant("weightless", "no gravity, no tension at the start", weightless),
)
OTHER = (
    Variant("beside", "NSH in parallel with the string, not in its place", beside),
    Variant("inertia", "J = m l²/12 in M, as printed", printed_inertia),
    Variant(
        "hold_tension_only",
        "48 N beyond 9 cm, and dampers never push",
        lambda model: tension_only(BEYOND[0].change(model)),
    ),
)
TIGHTER = (
    Variant("tight_vertical", "vertical strings 10 cm shorter, settled", shortened(0.1, top=False)),
    Variant("tight_top", "top strings 20 cm shorter, settled", shortened(0.2, top=True)),
)
HEAVIER = tuple(Variant(f"d_times_{f:g}", f"every d {f:g} times as large", damping=f) for f in (2.0, 5.0, 10.0))
SINGLE_VALUED = Variant("series", "k in series with the NSH, single-valued", in_series("single_valued"))
HYSTERETIC = Variant("memory", "k in series with the NSH, with memory (`hysteretic`)", in_series("hysteretic"))
STRINGS = (LAW, *BEYOND, *DAMPERS, SINGLE_VALUED, HYSTERETIC)
OSCILLATORS = (
    Variant("k15", "k = 15 kN/m, as in the 2D system", oscillator={"stiffness": 15000.0}),
    Variant("d50", "d = 50 N s/m", oscillator={"damping": 50.0}),
    Variant("d1000", "d = 1000 N s/m", oscillator={"damping": 1000.0}),
    Variant("d5000", "d = 5000 N s/m", oscillator={"damping": 5000.0}),
    Variant("m10", "m = 10 kg", oscillator={"mass": 10.0}),
    Variant("pm100", "the force is +100 and -100 N", oscillator={"low": -100.0}),
    Variant("pm50", "the force is +50 and -50 N", oscillator={"high": 50.0, "low": -50.0}),
    Variant("pm50_m10", "+50 and -50 N, m = 10 kg", oscillator={"high": 50.0, "low": -50.0, "mass": 10.0}),
)
VARIANTS = {
    "I": (BASE, *PRESTRESS, *STRINGS),
    "II": (BASE, *PHASES, *STRINGS, *HEAVIER, *GRAVITY, *TIGHTER, *OTHER),
    "III": (BASE, *PRESTRESS, *STRINGS),
    "IV": (BASE, *OSCILLATORS),
}
