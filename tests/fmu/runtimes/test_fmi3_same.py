"""FMUs of FMI 3.0 give what those of FMI 2.0 give under the same calls, to the last bit; fmpy runs them as it runs any.

All scenes, and scenes with drives, memory and other elements, for longer: ``python -m tests.fmu.runtimes.test_fmi3_same``.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

from fmu_src.build import main as build
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.validation import exchange, outside, outside3
from fmu_src.validation.validate import run_outside
from fmu_src.variables.arrays import element_names
from fmu_src.variables.interface import variables
from tensegrity_core.scene import builtin_scenes
from tests.support import element_scenes, scene
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, built
from tests.support.words import words

MODELS = {
    **{name: lambda name=name: scene(name) for name in builtin_scenes()},
    "laboratory": lambda: built(LABORATORY),
    "mast": lambda: built(MAST),
    "pendulum": lambda: built(PENDULUM, moving=["n1"], point_masses={"n2": 0.5}, drag={"n2": 0.4}),
    "afloat": lambda: built(AFLOAT, gravity=9.81),
    **{f"{name} string": lambda name=name: element_scenes.mast(name) for name in element_scenes.STRINGS},
}


def instance(model, fmi, folder, host=(), kind="cs"):
    """An FMU of a model in a folder of its own, as a host of the validation has it."""
    folder.mkdir(parents=True)
    fmu = pack_native_fmu(model, folder / "one.fmu", kind=kind, standard=fmi)
    description = read_model_description(str(fmu))
    make = outside3.instances("coSimulation", host) if fmi == "3.0" else outside.Instance
    return make(description, extract(str(fmu), str(folder / "one")), logging=True, categories=("logEvents",))


def given(model, steps, seed=0):
    """Times and held inputs (steps, n) that strings go slack under, and their names in FMI 2.0."""
    rows, random = [row for row in variables(model) if row.causality == "input"], np.random.default_rng(seed)
    sizes = {"N": 30.0, "m": 0.02, "m/s": 0.3, "m/s2": 1.0, "A": 0.2}
    start = np.array([row.start for row in rows])
    size = np.array([sizes[row.unit] for row in rows])
    held = np.repeat(random.normal(size=((steps + 3) // 4, len(rows))), 4, axis=0)[:steps]
    return 0.01 * np.arange(steps + 1), start + size * held, [row.name for row in rows]


def same_calls(model, folder, steps, host=()):
    """Largest differences of the outputs of FMI 2.0 and 3.0, absolute and in terms of their bound's size, and the events."""
    times, values, names = given(model, steps)
    own, table = element_names(variables(model)), {row.name: row.reference for row in variables(model)}
    rows, events = [], []
    for fmi in ("2.0", "3.0"):
        one = instance(model, fmi, folder / fmi, host)
        inputs = [v.name for v in one.description.modelVariables if v.causality == "input"]
        out, outputs, _ = outside.run(one, times, values, inputs if fmi == "3.0" else names, {})
        one.close()
        told = outputs if fmi == "3.0" else [own[table[name]] for name in outputs]
        rows.append(dict(zip(told, out.T, strict=True)))
        events.append([text for _, category, text in one.messages if category == "logEvents"])
    assert set(rows[0]) == set(rows[1])
    if "early" in host:  # a scale, whose integrand has kinks that no step is cut at
        rows[0].pop("energy.throughput")
    worst = max(float(np.max(np.abs(rows[0][n] - rows[1][n]) / (1.0 + np.abs(rows[0][n])))) for n in rows[0])
    return worst, events


@pytest.mark.parametrize("name", MODELS)
def test_the_same_calls_give_the_same_bits(name, tmp_path):
    worst, events = same_calls(MODELS[name](), tmp_path, 16)
    assert worst == 0.0 and events[0] == events[1]


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar", "laboratory", "mast", "pendulum"])
def test_event_mode_gives_the_same(name, tmp_path):
    """Inputs that jump in Event Mode are inputs that jump at the start of the step."""
    worst, events = same_calls(MODELS[name](), tmp_path, 16, ("events",))
    assert worst < 1e-12 and len(events[0]) == len(events[1])


@pytest.mark.parametrize("host", [("early",), ("events", "early")], ids=str)
@pytest.mark.parametrize("name", ["three_bar_nsh", "laboratory"])
def test_steps_that_end_at_transitions_give_the_same_motion(name, host, tmp_path):
    """To the solver's tolerance, whose steps are others."""
    worst, events = same_calls(MODELS[name](), tmp_path, 12, host)
    assert worst < 1e-8 and events[0] and len(events[0]) == len(events[1])


@pytest.mark.parametrize("name", ["two_bar_nsh", "mast"])
def test_model_exchange_gives_the_same(name, tmp_path):
    """CVODE takes the same steps."""
    model = MODELS[name]()
    fmus = {fmi: pack_native_fmu(model, tmp_path / f"{fmi}.fmu", kind="me", standard=fmi) for fmi in ("2.0", "3.0")}
    times, values, _ = given(model, 8)
    found = []
    for fmi, fmu in fmus.items():
        description = read_model_description(str(fmu))
        make = outside3.instances("modelExchange") if fmi == "3.0" else exchange.Instance
        one = make(description, extract(str(fmu), str(tmp_path / fmi)))
        names = [v.name for v in description.modelVariables if v.causality == "input"]
        out, outputs, _ = exchange.run(one, times, values, names, {})
        one.close()
        found.append(
            out[:, np.argsort([one.by_name[name.partition("[")[0]].valueReference for name in outputs], kind="stable")]
        )
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-9)


class Looking(outside3.Instance):
    """A host that looks at a vector within steps."""

    def _chosen(self):
        self.seen = []
        return {"intermediateUpdate": self.look}

    def look(self, environment, time, set_requested, get_allowed, finished, can_return, requested, at):
        if get_allowed:
            self.seen.append((time, self.get("n4.position"), bool(set_requested), bool(can_return)))


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar"])
def test_a_look_into_steps_changes_nothing(name, tmp_path):
    """Outputs within steps are of the same motion, at times that go on; what follows is the same to the last bit."""
    model = MODELS[name]()
    times, values, _ = given(model, 12)
    fmu = pack_native_fmu(model, tmp_path / "one.fmu", standard="3.0")
    description, folder = read_model_description(str(fmu)), extract(str(fmu), str(tmp_path / "one"))
    inputs = [v.name for v in description.modelVariables if v.causality == "input"]
    allowed = {
        v.get("name")
        for v in ElementTree.parse(f"{folder}/modelDescription.xml").iterfind("ModelVariables/*[@intermediateUpdate]")
    }
    assert allowed == {v.name for v in description.modelVariables if v.causality == "output" and v.variability == "continuous"}
    one, two = Looking(description, folder), outside3.instances("coSimulation")(description, folder)
    found, right = (outside.run(host, times, values, inputs, {}) for host in (one, two))
    np.testing.assert_array_equal(found[0], right[0])
    at, places, asked, ends = zip(*one.seen, strict=True)
    assert len(at) > 5 and np.all(np.diff(at) >= 0.0) and times[0] < at[0] and at[-1] <= times[-1]
    assert not any(asked) and not any(ends)
    place = [found[1].index(f"n4.position[{i + 1}]") for i in range(len(model.axes))]
    for instant, position in zip(at, places, strict=True):
        after = int(np.searchsorted(times, instant))
        both = found[0][after - 1 : after + 1, place]
        assert np.max(np.abs(position - both[0])) <= np.max(np.abs(both[1] - both[0])) + 0.01  # near the ends of its step
    one.close()
    two.close()


# As anybody runs them


def test_the_command_builds_and_fmpy_runs_both_kinds(tmp_path):
    """Arrays come and go whole; planar scenes have two axes."""
    words = ["two_bar", "three_bar_nsh", "--fmi", "3.0", "--kind", "both", "--no-validate", "--no-page"]
    assert build([*words, "--output", str(tmp_path)]) == 0
    for name, axes in (("two_bar", 2), ("three_bar_nsh", 3)):
        fmu = str(tmp_path / "both-fmi3" / f"{name}.fmu")
        assert validate_fmu(fmu) == []
        lift = [0.0] * (axes - 1) + [20.0]
        ends = []
        for kind in ("CoSimulation", "ModelExchange"):
            run = {"fmi_type": kind, "stop_time": 0.2, "output_interval": 0.02, "relative_tolerance": 1e-10}
            ends.append(simulate_fmu(fmu, **run, start_values={"n4.force": lift}, output=["n4.position", "s1.force"])[-1])
        assert np.shape(ends[0]["n4.position"]) == (axes,)
        np.testing.assert_allclose(ends[0]["n4.position"], ends[1]["n4.position"], atol=1e-7)
        rest = simulate_fmu(fmu, fmi_type="CoSimulation", stop_time=0.2, output=["n4.position"])[-1]["n4.position"]
        assert ends[0]["n4.position"][-1] > rest[-1] + 1e-4


def test_flat_names_run_too(tmp_path):
    fmu = pack_native_fmu(scene("three_bar_nsh"), tmp_path / "flat.fmu", naming="flat", standard="3.0")
    assert validate_fmu(str(fmu)) == []
    found = simulate_fmu(str(fmu), stop_time=0.1, start_values={"s1_nsh_h": [0.015] * 4}, output=["n4_position"])
    assert len(found[-1]["n4_position"]) == 3


def test_a_run_from_outside_compares_arrays_with_the_reference(tmp_path):
    """The host that the validation starts, in an interpreter of its own, in a folder with an odd name."""
    from fmu_src.validation.scenarios import scenarios

    model = scene("two_bar_nsh")
    run = scenarios(model, 0.2)[0]
    fmu = pack_native_fmu(model, tmp_path / "ü #1" / "one.fmu", standard="3.0")
    ((outputs, _, _),) = run_outside(fmu, model, runs=[run], fmi="3.0")
    ((right, _, _),) = run_outside(pack_native_fmu(model, tmp_path / "two.fmu"), model, runs=[run])
    assert outputs.keys() == right.keys()
    assert all(np.array_equal(outputs[name], right[name]) for name in right)


def main() -> None:
    """Every model, 200 steps, in each way that a host may step."""
    for name, make in MODELS.items():
        for host in ((), ("events",), ("early",), ("events", "early")):
            with tempfile.TemporaryDirectory() as folder:
                worst, events = same_calls(make(), Path(folder), 200, host)
            print(
                f"{name:<24}{' '.join(host) or 'plain':<16}{worst:.1e}{len(events[0]):>8}{len(events[1]):>8} events", flush=True
            )


if __name__ == "__main__":
    words(__doc__)
    main()
