"""NumPy's numbers and arrays go where Python's floats and lists go, with the same results."""

import dataclasses

import numpy as np
import pytest

from tensegrity_core import laws, statics
from tensegrity_core.article import experiments, one_dimensional
from tensegrity_core.equilibria import modes, paths, steady_states
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.laws import hysteresis
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.model import NSH, Actuator, grid, held
from tensegrity_core.model.elements import Beam, Parallel, Polynomial, Series, Spring, Table
from tensegrity_core.reference import simulate as reference
from tensegrity_core.scene import parse_scene, towers
from tests.scene.test_scene import GOOD
from tests.support import push, scene

# Numbers that every kind can hold exactly, so that results must be the same to the last bit.
KINDS = {
    "float": lambda x: x,
    "float64": np.float64,
    "float32": np.float32,
    "longdouble": np.longdouble,
    "array without dimensions": np.array,
    "int": lambda x: int(x) if float(x).is_integer() else x,
    "int64": lambda x: np.int64(x) if float(x).is_integer() else np.float64(x),
    "int32 array": lambda x: np.array(x, dtype=np.int32 if float(x).is_integer() else np.float32),
}
LISTS = {"tuple": tuple, "list": list, "array": np.array, "float32 array": lambda x: np.array(x, dtype=np.float32)}
MODEL, MOTOR = scene("three_bar_nsh"), (2.0, 0.5, 0.25, 0.125)


def of_laws(n, seq):
    beam = Beam(n(6.0), n(5.0), n(0.0078125))
    table = Table(seq((0.0, 0.5, 1.0)), seq((0.0, 2.0, 8.0)), "cubic")
    tree = Series((Parallel(seq_of_parts := [beam, Spring(n(256.0))]), Polynomial(seq((1024.0, 0.0, 2.0))), table))
    assert len(seq_of_parts) == 2
    made, memory = laws.law(tree, n(512.0)), Series((beam, beam), "hysteretic")
    found = [
        made.force(n(0.25)),
        made.stiffness(n(0.25)),
        made.energy(n(0.25)),
        made.elongation(n(4.0)),
        made.force(n(3.0)),
    ]
    damper = laws.damping(Polynomial(seq((2.0, 1.0))))
    found += [damper.force(n(-0.5)), damper.slope(n(0.5)), hysteresis.start(memory, n(4096.0)).elongation(n(8.0))]
    return [*found, hysteresis.follow(hysteresis.start(memory, n(4096.0)), n(0.03125))[0].force(n(0.03125))]


def of_nsh(n, seq):
    one = NSH(seq((6.0, 8.0)), seq((3.0, 4.0)), seq((0.0078125, 0.015625)))
    made = laws.law(one.element, n(512.0))
    values = [f(n(0.015625)) for f in (made.force, made.stiffness, made.energy)]
    return [*values, made.elongation(n(10.0)), *made.breakpoints, beam_extrema(n(6.0), n(3.0), n(0.5)).f_max]


def of_runs(n, seq):
    times = grid(n(0.25), n(0.0625), n(1.0))
    row = push(MODEL)
    inputs = held(MODEL, times if seq is not list else times.tolist(), force=lambda t: row.tolist() if seq is list else row)
    ours = simulate(MODEL, inputs, tolerance=n(0.0009765625), max_step=n(0.0625), method="dop853")
    theirs = reference(MODEL, inputs, rtol=n(0.0009765625), atol=n(0.0009765625))
    kernel = Kernel(MODEL, tolerance=n(0.0009765625))
    kernel.initialize(n(1.0))
    kernel.step(n(0.0625))
    law = kernel.string_law(np.int64(0), n(0.015625))
    return [ours.position, theirs.position, kernel.values.copy(), law, kernel.piece_law(np.int64(0), np.int32(1), n(0.0078125))]


def of_models(n, seq):
    actuator = Actuator(*(n(x) for x in MOTOR))
    model = dataclasses.replace(
        scene("three_bar"),
        gravity=n(8.0),
        bar_mass=seq((1.0, 2.0, 1.0)),
        stiffness=seq((4096.0,) * 6),
        damping=seq((512.0,) * 6),
        point_mass=((np.int64(3), n(2.0)),),
        drag=((np.int64(4), n(0.5)),),
        actuator=(None,) * 5 + (actuator,),
        current=seq((8.0,)),
    )
    kernel = Kernel(model)
    kernel.initialize()
    vector = Kernel(dataclasses.replace(model, gravity=seq((0.0, 1.0, -8.0))))
    return [
        kernel.values.copy(),
        vector["gravity"].copy(),
        statics.residual(model),
        [abs(m.eigenvalue) for m in modes.modes(model)],
    ]


def of_scenes(n, seq):
    import tomllib

    data = tomllib.loads(GOOD)
    data["gravity"] = n(8.0)
    data["nodes"] = {
        name: seq(point) for name, point in {"n1": (0.0, 0.0), "n2": (1.0, 0.0), "n3": (0.75, 1.0), "n4": (0.25, 1.0)}.items()
    }
    data["nsh"]["soft"] = {"Q": seq((6.0, 8.0)), "zeta": seq((3.0, 4.0)), "h": seq((0.0078125, 0.015625))}
    data["prestress"]["tension"]["s3"] = n(16.0)
    data["elements"] = {"one": {"kind": "spring", "stiffness": n(256.0)}}
    model = statics.build_model(parse_scene(data))
    tower = towers.tower(
        np.int64(2) if n is not KINDS["float"] else 2, tension=n(32.0), stiffness=n(8192.0), damping=n(256.0), mass=n(1.0)
    )
    return [model.rest_length, model.stiffness, model.nodes, list(tower.prestress.tension.values()), tower.gravity]


def of_equilibria(n, seq):
    row = np.zeros((6, 3))
    row[3:, 2] = 1.0
    row = row.tolist() if seq is list else row
    loading = Loading(MODEL, force_direction=row)
    path = paths.follow(loading, n(0.0), n(4.0))
    sweep = steady_states.load_sweep(loading, seq((0.0, 2.0, 4.0)))
    settled = statics.settle(MODEL, force=row, rest_length=MODEL.rest_length.tolist() if seq is list else None, steps=2)
    found = modes.modes(MODEL, force=row)
    return [path.parameters, path.points[-1].free, sweep.nodes, settled.nodes, [m.eigenvalue.real for m in found]]


def of_experiments(n, seq):
    oscillator = one_dimensional.Oscillator(n(2.0), n(512.0), n(4.0))
    motion = one_dimensional.simulate(oscillator, seq((0.0, 0.25, 0.5)), seq((1.0, 2.0)))
    heights = experiments.steady_heights(scene("two_bar"), seq((8.0,)), n(0.25), n(0.0009765625))
    return [motion.position if hasattr(motion, "position") else motion.x, heights.height]


GROUPS = [of_laws, of_nsh, of_runs, of_models, of_scenes, of_equilibria, of_experiments]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_kind_of_number_gives_the_same(group):
    exact = group(KINDS["float"], tuple)
    for kind, lists in zip(KINDS, [*LISTS, *LISTS]):
        for wanted, found in zip(exact, group(KINDS[kind], LISTS[lists]), strict=True):
            np.testing.assert_array_equal(np.asarray(found), np.asarray(wanted), err_msg=f"{kind}, {lists}")


@pytest.mark.parametrize(
    "bad", ["1", None, [1.0, 2.0], np.array([1.0, 2.0]), 1j, object(), 10**400], ids=lambda bad: type(bad).__name__
)
def test_what_is_no_number_is_an_input_error(bad):
    makes = [
        lambda: Spring(bad),
        lambda: Beam(bad, 5.0, 0.01),
        lambda: Polynomial((1.0, bad)),
        lambda: Table((0.0, 1.0), (0.0, bad)),
        lambda: NSH((bad,), (4.0,), (0.01,)),
        lambda: Actuator(1.0, 0.0, 1.0, bad),
        lambda: grid(bad, 0.01),
        lambda: grid(1.0, bad),
        lambda: Kernel(MODEL).step(bad),
        lambda: Kernel(MODEL).initialize(bad),
        lambda: Kernel(MODEL, tolerance=bad),
        lambda: laws.law(Spring(1.0)).elongation(bad),
        lambda: paths.follow(Loading(MODEL, np.ones((6, 3))), 0.0, bad),
        lambda: towers.tower(2, mass=bad) if bad is not None else Spring(bad),
        lambda: towers.tower(bad),
    ]
    for make in makes:
        with pytest.raises(InputError):
            make()
