"""Coupled FMUs against the same loop in one, at few steps: python -m benchmarks.coupling.run has the whole of it."""

from __future__ import annotations

import ast
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.ssp.ssd import find_components, read_ssd
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from benchmarks.coupling import blocks, linear, master, monolithic, run, system, tools
from fmu_src.packing import ssp

DURATION = 0.6


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    return system.pack(tmp_path_factory.mktemp("parts"))


@pytest.fixture(scope="module")
def whole():
    """Heights of the loop in one, each 5 ms."""
    return monolithic.heights(system.LOOP, np.arange(121) * 0.005)


def error(scheme, h, parts, whole):
    found, _ = master.run(system.plan(), parts, master.SCHEMES[scheme], h, round(DURATION / h))
    return np.max(np.abs(found - whole[:: round(h / 0.005)]))


def test_descriptions_are_valid(parts):
    assert [validate_fmu(str(path)) for path in dict.fromkeys(parts.values())] == [[]] * 3


def test_the_loop_in_one_is_the_same_by_another_method(whole):
    other = monolithic.heights(system.LOOP, np.arange(0, 121, 20) * 0.005, "Radau", 1e-9, 1e-11)
    np.testing.assert_allclose(other, whole[::20], atol=1e-9)


@pytest.mark.parametrize(
    "scheme, order, largest",
    [
        ("jacobi", 1, 3e-3),
        ("gauss_seidel", 1, 1.5e-3),
        ("jacobi_derivatives", 2, 7e-4),
        ("gauss_seidel_derivatives", 2, 6e-5),
        ("iterated", 2, 6e-5),
    ],
)
def test_coupling_converges_to_the_loop_in_one(scheme, order, largest, parts, whole):
    coarse, fine = (error(scheme, h, parts, whole) for h in (0.01, 0.005))
    assert coarse < largest
    assert order - 0.3 < np.log2(coarse / fine) < order + 0.9


def test_without_rates_the_error_stays(parts, whole):
    coarse, fine = (error("jacobi_no_rate", h, parts, whole) for h in (0.01, 0.005))
    assert fine > 0.9 * coarse > 5e-3


@pytest.mark.parametrize("scheme", ["jacobi", "gauss_seidel_derivatives"])
def test_fmus_go_unstable_where_the_linear_system_does(scheme, parts):
    coupling = linear.Coupling(system.LOOP, master.SCHEMES[scheme])
    limit = linear.largest_step(coupling, np.geomspace(5e-3, 0.1, 8))
    for factor in (0.95, 1.05):
        h = factor * limit
        assert linear.seen_growth(parts, master.SCHEMES[scheme], h) == pytest.approx(coupling.growth(h), abs=0.01)


def test_a_winch_is_exact_whatever_the_step(parts):
    """Its command is a ramp steeper than the rate limit, up to 0.35 s and then back: in 14 and in 140 steps, and by SciPy."""

    def ramp(t):
        return 1.0 + np.where(t < 0.35, 0.3 * t, 0.105 - 0.5 * (t - 0.35))

    ends = []
    for per_row in (1, 10):
        unit, h, found = master.FMUnit(parts["winch_s4"], "winch"), 0.05 / per_row, []
        unit.begin({"start_rest_length": 1.0, "command": 1.0})
        unit.fmu.exitInitializationMode()
        for k in range(14 * per_row):
            unit.put(["command"], [ramp(k * h)], [0.3 if k < 7 * per_row else -0.5])
            unit.step(k * h, h)
            if (k + 1) % per_row == 0:
                found.append(unit.get(["rest_length", "rest_length_rate"]))
        unit.close()
        ends.append(np.array(found))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-14)
    times = np.linspace(0.05, 0.7, 14)
    tight = {"rtol": 1e-12, "atol": 1e-12, "max_step": 1e-3}
    solved = solve_ivp(
        lambda t, y: np.clip((ramp(t) - y) / 0.1, -0.1, 0.1), (0.0, 0.7), [1.0], "DOP853", times.round(9), **tight
    )
    np.testing.assert_allclose(ends[0][:, 0], solved.y[0], atol=1e-8)
    assert np.ptp(ends[0][:, 1]) == pytest.approx(0.2), "both limits were reached"


@pytest.fixture(params=ssp.VERSIONS)
def archive(request, parts, tmp_path):
    return ssp.write_ssp(tmp_path / "ü #1" / "height.ssp", system.as_ssp(parts, 2.0), request.param), request.param


def wires(read):
    """fmpy's own get_connections adds some that the description has not."""
    ends = ("startElement", "startConnector", "endElement", "endConnector")
    return tuple(ssp.Wire(*(getattr(connection, end) for end in ends)) for connection in read.system.connections)


def test_an_ssp_is_the_plan_and_its_fmus(archive, parts):
    """As fmpy reads it; version 1.0 by the schemas that come with it, too."""
    path, version = archive
    read = read_ssd(str(path), validate=version == "1.0")
    assert (read.version, read.name) == (version, system.NAME)
    plan, components = system.plan(), {one.name: one for one in find_components(read.system)}
    assert tuple(components) == plan.units
    assert wires(read) == plan.wires
    with zipfile.ZipFile(path) as file:
        for name, one in components.items():
            assert file.read(one.source) == parts[name].read_bytes()
            (binding,) = one.parameterBindings
            (values,) = binding.parameterValues
            assert values.name == ssp.PARAMETERS
            assert {parameter.name: float(parameter.value) for parameter in values.parameters} == plan.start[name]


def test_an_ssp_runs_in_fmpy_as_the_plan_does(archive, parts, whole, tmp_path):
    """From the archive alone: FMUs, connections and start values as fmpy reads them."""
    path, version = archive
    read = read_ssd(str(path), validate=version == "1.0")
    with zipfile.ZipFile(path) as file:
        file.extractall(tmp_path / "unpacked")
    components = find_components(read.system)
    start = {
        one.name: {p.name: float(p.value) for p in one.parameterBindings[0].parameterValues[0].parameters} for one in components
    }
    files = {one.name: tmp_path / "unpacked" / one.source for one in components}
    found, _ = master.run(system.plan()._replace(start=start, wires=wires(read)), files, master.SCHEMES["jacobi"], 0.01, 20)
    mine, _ = master.run(system.plan(), parts, master.SCHEMES["jacobi"], 0.01, 20)
    np.testing.assert_array_equal(found, mine)


def test_the_command_writes_the_archive(tmp_path, capsys, monkeypatch):
    assert system.main(["--output", str(tmp_path / "one.ssp"), "--ssp", "1.0"]) == 0
    assert read_ssd(str(tmp_path / "one.ssp")).version == "1.0"
    monkeypatch.setenv("CC", "no-such-compiler")
    assert system.main(["--output", str(tmp_path / "two.ssp")]) == 2
    assert "no-such-compiler" in capsys.readouterr().err and not (tmp_path / "two.ssp").exists()


def test_the_page_comes_from_its_data():
    path = Path(__file__).resolve().parents[2] / "docs"
    data = run.PAGE.read(path / "coupling.json")
    assert (path / run.PAGE.file).read_text(encoding="utf-8") == run.report(data)
    assert [round(run.order(data["schemes"][name])) for name in master.SCHEMES] == [0, 1, 1, 2, 2, 2]
    assert run.parted(data) < 0.02
    for row in data["tools"]:
        assert {"libcosim": True, "ecos": row["ssp"] == "1.0"}[row["tool"]] == bool(row["errors"])
        assert max(row["apart"], default=0.0) < 1e-9
    for driver in tools.OF:
        ast.parse((tools.DRIVERS / f"{driver}.py").read_text(encoding="utf-8"))


def test_blocks_refuse_what_they_do_not_know(parts):
    unit = master.FMUnit(parts["controller"], "controller")
    with pytest.raises(FMICallException, match="discard"):
        unit.fmu.setReal([unit.references["command[1]"]], [1.0])
    with pytest.raises(FMICallException, match="discard"):
        unit.fmu.setReal([unit.references["gain"]], [np.nan])
    unit.begin({})
    unit.fmu.exitInitializationMode()
    with pytest.raises(FMICallException, match="discard"):
        unit.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.0)
    unit.close()


def test_the_table_of_a_block_is_what_its_source_knows():
    assert blocks.header(blocks.WINCH).count("START_REST_LENGTH") == 1
    assert blocks.identity(blocks.WINCH) != blocks.identity(blocks.CONTROLLER)
