"""The Python API that scripts begin with: names, inputs as signals, results with names, their files, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import tensegrity_core as tc
from fmu_src.variables.interface import variables
from tensegrity_core import kernel
from tensegrity_core.errors import InputError, SceneError, SimulationError, TensegrityError
from tensegrity_core.model import grid, held
from tensegrity_core.output import series
from tensegrity_core.output.page import Parts, document
from tests.support import push, scene
from tests.support.driven_scenes import LABORATORY, built

SHORT = {"duration": 0.4, "step": 0.02}


def test_the_package_alone_imports_nothing():
    done = subprocess.run([sys.executable, "-c", "import tensegrity_core, sys; assert 'numpy' not in sys.modules"])
    assert done.returncode == 0
    assert set(tc.__all__) <= set(dir(tc))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        tc.simulat  # noqa: B018 (the access is what is tested)


def test_a_run_is_the_kernels_under_the_fmus_names():
    run = tc.simulate("three_bar_nsh", {"n4.force.z": 45.0}, **SHORT)
    model = scene("three_bar_nsh")
    force = push(model, 0.0, 0.0)
    force[model.node_names.index("n4"), 2] = 45.0
    expected = kernel.simulate(model, held(model, grid(0.4, 0.02), force=lambda t: force))
    table = {row.name: row for row in variables(model) if row.causality == "output"}
    assert [name for name in run.data if not str(name).startswith("transition.")] == list(table)
    np.testing.assert_array_equal(run["n4.z"].values, expected.position[:, 3, 2])
    np.testing.assert_array_equal(run["s2.force"].values, expected.string_force[:, 1])
    np.testing.assert_array_equal(run["time"].values, expected.times)
    assert run.transitions["time"].tolist() == [t.time for t in expected.transitions] and len(run.transitions)
    assert run.transitions["string"].tolist() == [model.string_names[t.string] for t in expected.transitions]
    assert (run["n4.z"].attrs["units"], run["n4.velocity.z"].attrs["units"]) == ("m", "m s-1")
    known = {"scene": "three_bar_nsh", "method": "auto", "tolerance": 1e-10, "version": tc.__version__}
    assert known.items() <= run.data.attrs.items()
    assert run.to_frame().loc[0.4, "n4.z"] == expected.position[-1, 3, 2]


@pytest.mark.parametrize(
    "signal", [lambda t: 45.0 if t > 0.1 else 0.0, ([0.0, 0.1, 0.1, 9.0], [0.0, 0.0, 45.0, 45.0])], ids=["function", "rows"]
)
def test_a_jump_comes_at_its_time(signal):
    run = tc.simulate("three_bar_nsh", {"n4.force.z": signal}, duration=0.4, step=0.1)
    model = scene("three_bar_nsh")
    force = np.zeros((len(model.nodes), 3))
    force[3, 2] = 45.0
    expected = kernel.simulate(model, held(model, grid(0.4, 0.1), force=lambda t: force * (t > 0.1)))
    np.testing.assert_array_equal(run["n4.z"].values, expected.position[:, 3, 2])


def test_a_rest_length_moves_with_its_rate():
    model = scene("two_bar")
    length = model.rest_length[2]
    run = tc.simulate("two_bar", {"s3.rest_length": ([0.0, 0.4], [length, length - 0.05])}, **SHORT)
    expected = kernel.simulate(
        model, held(model, grid(0.4, 0.02), rest_length=lambda t: model.rest_length - [0.0, 0.0, 0.125 * t])
    )
    np.testing.assert_allclose(run["n3.z"].values, expected.position[:, 2, 2], rtol=0.0, atol=1e-12)
    assert np.ptp(run["n3.z"].values) > 1e-3


def test_moved_nodes_and_currents_are_inputs_too():
    """In a scene that has all of them, against the same inputs as arrays."""
    model = built(LABORATORY)
    moved, start = [model.node_names[i] for i in model.moving], model.nodes[list(model.moving)]
    way, speed = (lambda t: 0.01 * np.sin(9.0 * t)), (lambda t: 0.09 * np.cos(9.0 * t))
    signals = {f"{moved[1]}.position.y": lambda t: start[1, 1] + way(t), f"{moved[1]}.velocity.y": speed}
    signals |= {"s9.current": lambda t: 2.0 * t, "s4.actuator.load": 3.0}
    run = tc.simulate(model, signals, **SHORT)

    def motion(t):
        place, velocity = start.copy(), np.zeros((2, 3))
        place[1, 1], velocity[1, 1] = start[1, 1] + way(t), speed(t)
        return place, velocity

    wound = [model.string_names[i] for i in model.actuated]
    current = lambda t: np.where([name == "s9" for name in wound], 2.0 * t, model.current)  # noqa: E731 (a signal)
    load = lambda t: np.where([name == "s4" for name in wound], 3.0, model.drum_load)  # noqa: E731 (a signal)
    inputs = held(model, grid(0.4, 0.02), current=current, drum_load=load, motion=motion)
    expected = kernel.simulate(model, inputs)
    np.testing.assert_array_equal(run[f"{moved[1]}.y"].values, expected.position[:, model.moving[1], 1])
    np.testing.assert_array_equal(run["s9.force"].values, expected.string_force[:, model.string_names.index("s9")])
    assert np.ptp(run[f"{moved[1]}.y"].values) > 0.005
    with pytest.raises(InputError, match="its position and its velocity over time; give both"):
        tc.simulate(model, {f"{moved[1]}.velocity.y": speed}, **SHORT)


@pytest.mark.parametrize("ending", [".nc", ".parquet", ".csv"])
def test_a_run_is_read_as_it_was_written(ending, tmp_path):
    run = tc.simulate("two_bar_nsh", {"n4.force.z": 60.0}, **SHORT)
    path = run.save(tmp_path / f"run{ending}")
    found = series.read(path)
    for name in run.data:
        if ending != ".csv" or not str(name).startswith("transition."):
            np.testing.assert_array_equal(found[name].values, run.data[name].values, err_msg=str(name))
    if ending != ".csv":
        assert found["n4.z"].attrs == run["n4.z"].attrs
        assert {name: found.attrs[name] for name in run.data.attrs} == run.data.attrs
        assert series.transitions(found).equals(run.transitions)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_result_is_a_file_of_inputs_where_it_has_them(tmp_path):
    (tmp_path / "in.csv").write_text("time,n4.force.z,n4.x\n0,0,7\n0.2,30,7\n", encoding="utf-8")
    from_file = tc.simulate("two_bar", tmp_path / "in.csv", **SHORT)
    given = tc.simulate("two_bar", {"n4.force.z": ([0.0, 0.2], [0.0, 30.0])}, **SHORT)
    np.testing.assert_array_equal(from_file["n4.z"].values, given["n4.z"].values)


BAD_FILES = {
    "no input": ("time,n4.x\n0,1\n", "no column is an input of two_bar"),
    "unknown": ("time,n4.force.z,n9.force.z\n0,1,1\n", "n9.force.z is no input of two_bar; did you mean"),
    "misspelt alone": ("time,n4.forc.z\n0,1\n", "n4.forc.z is no input of two_bar; did you mean n4.force.z"),
    "no time": ("t,n4.force.z\n0,1\n", "no column `time`, but t, n4.force.z"),
    "backwards": ("time,n4.force.z\n1,1\n0,1\n", "time 0 s stands after 1 s; sort the rows"),
    "a text": ("time,n4.force.z\n0,much\n", "row 2, column n4.force.z: 'much' is not a finite number"),
    "a gap": ("time,n4.force.z\n0,1\n1,\n", "row 3, column n4.force.z: '' is not a finite number"),
    "empty": ("", "no rows of numbers"),
    "header only": ("time,n4.force.z\n", "no rows of numbers"),
    "longer rows": ("time,n4.force.z\n0,1,7\n1,2,9\n", "row 2 has 3 values, the header 2 names"),
    "a longer row": ("time,n4.force.z\n0,1\n1,2,9\n", "row 3 has 3 values"),
    "semicolons": ("time;n4.force.z\n0;1,5\n", "separate them with commas"),
    "twice": ("time,n4.force.z,n4.force.z\n0,1,1\n", "column n4.force.z stands twice"),
    "no name": ("time,n4.force.z,\n0,1,\n", "column 3 has no name"),
}


@pytest.mark.parametrize("text, told", BAD_FILES.values(), ids=BAD_FILES)
def test_a_bad_file_of_inputs_is_named(text, told, tmp_path):
    path = tmp_path / "in.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=".") as failure:
        tc.simulate("two_bar", path, **SHORT)
    assert told in str(failure.value) and str(failure.value).startswith(str(path))


def test_files_of_other_kinds_are_named(tmp_path):
    (tmp_path / "in.csv").write_bytes("time,größe\n".encode("latin-1"))
    for ending in ("nc", "parquet"):
        (tmp_path / f"in.{ending}").write_bytes(b"garbage")
    pd.DataFrame({"time": [1.0, 0.0], "n4.force.z": [1.0, 1.0]}).to_parquet(tmp_path / "late.parquet")
    dates = np.array(["2026-01-01", "2026-01-02"], dtype="datetime64[ns]")
    xr.Dataset({"n4.force.z": ("time", [0.0, 1.0])}, {"time": dates}).to_netcdf(tmp_path / "dates.nc", engine="scipy")
    wide = xr.Dataset({"n4.force.z": (("time", "k"), np.ones((2, 2)))}, {"time": [0.0, 1.0]})
    wide.to_netcdf(tmp_path / "wide.nc", engine="scipy")
    cases = {"in.csv": "save it as UTF-8", "in.nc": "no NetCDF 3 file", "dates.nc": "give seconds since the start"}
    cases |= {"in.parquet": "is no Parquet file, or a damaged one; write it anew", "late.parquet": "sort the rows by time"}
    cases |= {"wide.nc": "give it over time alone", "nowhere.csv": "No such file", "in.txt": "only .nc, .parquet, .csv"}
    for name, told in cases.items():
        with pytest.raises(InputError) as failure:
            tc.simulate("two_bar", tmp_path / name, **SHORT)
        assert told in str(failure.value) and name in str(failure.value)


def damaged(good: bytes, number: int) -> bytes:
    """Cut, with wrong bytes, or with a gap."""
    rng = np.random.default_rng(number)
    at = int(rng.integers(len(good)))
    if number % 3 == 0:
        return good[:at]
    if number % 3 == 1:
        content = bytearray(good)
        for place in rng.integers(len(good), size=5):
            content[place] = rng.integers(256)
        return bytes(content)
    return good[:at] + good[at + int(rng.integers(1, 200)) :]


@pytest.mark.parametrize("ending", [".nc", ".parquet", ".csv"])
def test_damaged_files_are_read_or_named_in_one_line(ending, tmp_path):
    path, refused = tc.simulate("two_bar", **SHORT).save(tmp_path / f"run{ending}"), 0
    good = path.read_bytes()
    for number in range(60):
        path.write_bytes(damaged(good, number))
        try:
            series.read(path)
        except InputError as failure:
            refused += 1
            assert str(failure).startswith(str(path)) and len(str(failure).splitlines()) == 1
    assert refused > 40


def test_tables_and_series_are_inputs_too():
    """A force over time: as rows, as a table over a column or its index, as a pandas Series, as a series of another run."""
    times, values = [0.0, 0.4], [0.0, 30.0]
    expected = tc.simulate("two_bar", {"n4.force.z": (times, values)}, **SHORT)["n4.z"].values
    table = pd.DataFrame({"time": times, "n4.force.z": values})
    array = xr.DataArray(values, coords={"time": times}, dims="time")
    for inputs in (
        table,
        table.set_index("time"),
        {"n4.force.z": table.set_index("time")["n4.force.z"]},
        {"n4.force.z": array},
        xr.Dataset({"n4.force.z": array}),
        {"n4.force.z": (np.array(times), np.array(values))},
    ):
        np.testing.assert_array_equal(tc.simulate("two_bar", inputs, **SHORT)["n4.z"].values, expected)


@pytest.mark.parametrize(
    "call, told",
    [
        (lambda: tc.load("two_bar", {1: 2}), "no dictionary by places"),
        (lambda: tc.load("two_bar", "gravity=0"), "no dictionary by places"),
        (lambda: tc.load("two_bar", {"extends": "three_bar"}), "another scene is not a change"),
        (lambda: tc.load("two_bar", {"bars": {}}), "bars = {} changes nothing; name a value in it, as in bars.b1.mass"),
        (lambda: tc.load("two_bar", {"bars": {"b1": {}}}), "bars.b1 = {} changes nothing"),
        (lambda: tc.load("two_bar", {"bars.b1.mass": 2.0, "bars": {"b1": {"mass": 3.0}}}), "bars and what lies in it"),
        (lambda: tc.simulate("two_bar", {"s1.rest_length": -1.0}), "s1.rest_length = -1.0 must not be negative (at t = 0 s)"),
        (lambda: tc.simulate("two_bar", {"s1.rest_length": ([0.0, 1.0], [0.9, -0.1])}, 1.0, 0.1), "s1.rest_length = "),
        (lambda: tc.simulate("two_bar", tolerance=5.0), "tolerance = 5.0 must lie between 1e-14 and 0.1"),
        (lambda: tc.simulate("two_bar", max_step=-3.0), "max_step = -3.0 must not be negative"),
        (lambda: tc.simulate("two_bar", {"n4.force.z": np.nan}), "n4.force.z = nan is not a finite number"),
        (lambda: tc.simulate("two_bar", duration=1e12), "takes 1e+14 samples, more than 10000000; shorten it"),
        (lambda: tc.simulate("two_bar", duration=1e300, step=1e-300), "takes inf samples"),
        (lambda: tc.simulate("two_bar", duration=0.1).save("a\0.csv"), "'a\\x00.csv' cannot be written: embedded null byte"),
        (lambda: tc.simulate("two_bar", duration=0.1).save("\ud800.csv"), "cannot be written: "),
        (lambda: tc.simulate("two_bar", duration=0.1).save("a" * 300 + ".csv"), "cannot be written: File name too long"),
        (lambda: tc.simulate("two_bar", 5), "give a dictionary by name"),
        (lambda: tc.simulate("two_bar", {1: 1.0}), "1 is no input of two_bar"),
        (lambda: tc.simulate("two_bar", pd.DataFrame({"n4.force.z": [1.0]})), "no column `time`"),
        (
            lambda: tc.equilibrium("two_bar", {"s1.rest_length": 0.5}),
            "s1.rest_length: a steady state is asked for under forces",
        ),
        (lambda: tc.equilibrium("two_bar", {"n4.force.z": ([0, 1], [1, 2])}), "n4.force.z"),
        (lambda: tc.modes("two_bar", {"n4.force.z": np.nan}), "n4.force.z = nan is not a finite number"),
        (lambda: tc.simulate("two_bar", duration=0.1)[5], "there is no 5"),
        (lambda: tc.build(tc.load("two_bar")), "two_bar: FMUs are built of a scene"),
        (lambda: tc.build("two_bar", runtime="x"), "'x' is none; use native, python or both"),
        (lambda: tc.build("two_bar", __file__), "no such folder can be made"),
        (lambda: tc.build("two_bar", kind="se"), "--kind se: there is no such kind; use cs, me, both"),
        (lambda: tc.build("two_bar", fmi="1.0"), "--fmi 1.0: FMUs are not written in that version; use 2.0 or 3.0"),
        (lambda: tc.build("two_bar", runtime="python", fmi="3.0"), "the Python runtime has FMI 2.0 only"),
    ],
)
def test_what_is_of_another_kind_is_an_error_of_the_project(call, told):
    with pytest.raises(InputError) as failure:
        call()
    assert told in str(failure.value) and len(str(failure.value)) < 700


def test_a_function_that_fails_is_named_with_its_time_and_its_cause():
    told = r"n4\.force\.z: its function fails at t = 0\.2\d* s \(IndexError: list index out of range\)"
    with pytest.raises(InputError, match=told) as failure:
        tc.simulate("two_bar", {"n4.force.z": lambda t: [1.0][int(t > 0.2)]}, **SHORT)
    assert isinstance(failure.value.__cause__, IndexError)


def test_a_force_beyond_all_numbers_is_refused_with_a_remedy():
    with pytest.raises(SimulationError, match=r"^step_too_small at t = 0\.0 s: .*; give smaller inputs"):
        tc.simulate("two_bar", {"n4.force.z": 1e300}, **SHORT)


@pytest.mark.parametrize(
    "signals, told",
    [
        ({"n4.force.q": 1.0}, "did you mean n4.force"),
        ({"s1.rest_length_rate": 1.0}, "follows from s1.rest_length"),
        ({"n4.force.z": "x"}, "'x' is not a number"),
        ({"n4.force.z": ([0.0, 1.0], [1.0])}, "give one value a time"),
        ({"n4.force.z": lambda t: None}, "n4.force.z"),
    ],
)
def test_bad_inputs_are_named(signals, told):
    with pytest.raises(InputError) as failure:
        tc.simulate("two_bar", signals, **SHORT)
    assert told in str(failure.value)


def test_a_scene_is_varied_by_the_places_in_its_file():
    model = tc.load("two_bar_nsh", {"gravity": 0.0, "materials.cable.stiffness": 900.0, "bars.b1.mass": 2.5})
    plain = tc.load("two_bar_nsh")
    assert (model.name, model.gravity) == ("two_bar_nsh", 0.0) and model.bar_mass.tolist() == [2.5, plain.bar_mass[1]]
    assert set(model.stiffness) == {900.0} and plain.gravity != 0.0
    with pytest.raises(SceneError, match=r"changes: materials\.cable\.stiffness = -1"):
        tc.load("two_bar", {"materials.cable.stiffness": -1.0})
    with pytest.raises(InputError, match="load the scene with them"):
        tc.load(model, {"gravity": 0.0})


def test_a_run_is_no_scene():
    run = tc.simulate("two_bar", duration=0.02)
    for call in (tc.load, tc.modes, tc.equilibrium):
        with pytest.raises(SceneError, match=r"Run.*is no scene.*run\.model"):
            call(run)
    with pytest.raises(InputError, match="None is no path"):
        run.save(None)


def test_changes_are_left_as_they_were_given():
    given = {"bars": {"b1": {"mass": 1.5}}, "bars.b2.mass": 1.5}
    assert tc.load("two_bar", given).bar_mass.tolist() == [1.5, 1.5]
    assert given == {"bars": {"b1": {"mass": 1.5}}, "bars.b2.mass": 1.5}


@pytest.mark.parametrize(
    "path", ["a" * 5000, "a" * 5000 + ".toml", "a\0.toml", "", ".", "/", "/dev/null", "\ud800.toml", 5, b"x"]
)
def test_what_can_be_no_scene_is_an_error_of_the_project(path):
    with pytest.raises(SceneError) as failure:
        tc.load(path)
    told = str(failure.value)
    assert len(told) <= 1500 and ("built-in scene" in told or "readable file" in told)


def test_series_that_memory_does_not_take_are_refused_before_they_are_made(monkeypatch):
    monkeypatch.setattr("tensegrity_core.model.inputs._memory", lambda: 5e5)
    with pytest.raises(InputError, match=r"the series of two_bar at 1001 samples take .* GB, this machine has 0.0005 GB"):
        tc.simulate("two_bar", duration=10.0)
    assert len(tc.simulate("two_bar", duration=1.0)["time"]) == 101


def test_names_in_a_file_may_be_flat(tmp_path):
    (tmp_path / "in.csv").write_text("time,n4_force_z,s1_length\n0,5,1\n", encoding="utf-8")
    expected = tc.simulate("two_bar", {"n4.force.z": 5.0}, **SHORT)
    xr.testing.assert_equal(tc.simulate("two_bar", tmp_path / "in.csv", **SHORT).data, expected.data)
    (tmp_path / "in.csv").write_text("time,n4_force_z,n4.force.z\n0,5,5\n", encoding="utf-8")
    with pytest.raises(InputError, match="n4.force.z stands twice, under a structured and a flat name"):
        tc.simulate("two_bar", tmp_path / "in.csv", **SHORT)


@pytest.mark.parametrize(
    "unit, told", [("N", "N"), ("N.s/m", "N s m-1"), ("m/s2", "m s-2"), ("kg.m2", "kg m2"), ("N.m/A", "N m A-1"), ("1", "1")]
)
def test_units_are_those_of_udunits(unit, told):
    assert series.udunits(unit) == told


def test_a_name_that_is_none_is_guessed():
    run = tc.simulate("two_bar", **SHORT)
    with pytest.raises(InputError, match=r"there is no 'n4.zz'; did you mean n4.z"):
        run["n4.zz"]


def test_an_equilibrium_stays_and_has_modes():
    lift = {"n4.force.z": 20.0}
    state = tc.equilibrium("three_bar_nsh", lift)
    assert state["n4.z"].attrs["units"] == "m" and float(state["energy.kinetic"]) < 1e-20
    run = tc.simulate(state.model, lift, duration=0.5, step=0.1)
    assert np.ptp(run["n4.z"].values) < 1e-9 and float(run["n4.z"][0]) == float(state["n4.z"])
    rest = tc.equilibrium("three_bar_nsh")
    assert float(state["n4.z"]) > float(rest["n4.z"])
    about = tc.modes(state, lift)
    assert [m.eigenvalue for m in about] == [m.eigenvalue for m in tc.modes("three_bar_nsh", lift)]
    assert about[0].decay_rate > 0.0


def test_fmus_are_built(tmp_path):
    built = tc.build("two_bar", tmp_path, runtime="native")
    assert built == {"native": tmp_path / "native" / "two_bar.fmu"} and built["native"].is_file()
    built = tc.build("two_bar", tmp_path, kind="both", fmi="3.0")
    assert built == {"native": tmp_path / "both-fmi3" / "two_bar.fmu"} and built["native"].is_file()
    with pytest.raises(TensegrityError, match="Did you mean two_bar"):
        tc.build("two_bars", tmp_path)


def test_a_scene_and_a_run_are_shown(tmp_path, monkeypatch):
    monkeypatch.setattr(document, "parts", lambda: Parts("@MODEL@", "", "", b""))
    live = tc.view("two_bar", tmp_path / "live.html").read_text(encoding="utf-8")
    played = tc.view(tc.simulate("two_bar", {"n4.force.z": 5.0}, **SHORT), tmp_path / "run.html").read_text(encoding="utf-8")
    assert json.loads(live)["packed"] and "run" not in json.loads(live)
    assert json.loads(played)["run"]["instants"] == 21 and json.loads(played)["run"]["force"]
    with pytest.raises(InputError, match=r"\.html"):
        tc.view("two_bar", tmp_path / "page.txt")
