"""The benchmarks' problems, and one quick turn of the work-precision benchmark."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))

import problems  # noqa: E402
import work_precision  # noqa: E402
import work_precision_data as data  # noqa: E402
import work_precision_nsh as nsh  # noqa: E402
from peers import native, toolchain  # noqa: E402
from peers.ladder import Ladder, Run, too_long  # noqa: E402


@pytest.fixture(scope="module")
def tools(tmp_path_factory):
    return toolchain.build(tmp_path_factory.mktemp("peers"))


def bench(name: str, tools: toolchain.Tools, folder: Path) -> native.Bench:
    return native.Bench(problems.problem(name), tools, folder)


def error(run: Run, exact: Run, problem: problems.Problem) -> float:
    assert run.failure is None
    return work_precision.deviation(run, exact, problem)


@pytest.mark.parametrize("name", problems.names())
def test_problem_is_consistent(name):
    problem = problems.problem(name)
    model = problem.model
    assert problem.name == name and problem.force.shape == model.nodes.shape
    assert not problem.force[model.fixed].any() and not model.fixed[problem.judged].any()
    assert problem.kernel_force.size == len(model.free_nodes) * len(model.axes)
    along = np.einsum("bd,bd->b", *(np.diff(x[model.bars], axis=1)[:, 0] for x in (model.nodes, model.velocity)))
    assert np.abs(along).max() < 1e-14  # the start keeps the bars' lengths


def test_conservative_problems_start_as_they_are_meant_to():
    flight, tumbling = problems.free_flight().model, problems.tumbling().model
    strung = np.linalg.norm(np.diff(flight.nodes[flight.strings], axis=1)[:, 0], axis=1)
    tension = flight.stiffness * (strung - flight.rest_length)
    force = np.zeros((6, 3))
    for (i, j), pull, length in zip(flight.strings, tension, strung):
        along = (flight.nodes[j] - flight.nodes[i]) * pull / length
        force[i] += along
        force[j] -= along
    for i, j in flight.bars:  # prestress: what strings pull on a bar's ends is axial and balanced
        bar = (flight.nodes[j] - flight.nodes[i]) / flight.bar_length[0]
        assert force[i] == pytest.approx((force[i] @ bar) * bar, abs=1e-12)
        assert force[i] + force[j] == pytest.approx(np.zeros(3), abs=1e-12)
    assert tension[6] == pytest.approx(20.0)
    assert not tumbling.damping.any() and tumbling.gravity == 0.0


def test_unknown_problem_is_refused():
    with pytest.raises(SystemExit, match="four_bar/50.*three_bar/50"):
        problems.problem("four_bar/50")


@pytest.mark.parametrize(("damping", "transitions"), [(50, 26), (500, 8), (5000, 8)])
def test_kernel_through_the_benchmark_finds_every_transition(tools, tmp_path, damping, transitions):
    b = bench(f"three_bar/{damping}", tools, tmp_path)
    exact, apart = work_precision.reference(b)
    assert exact.counts["transitions"] == transitions
    assert max(apart.values()) < 1e-9
    for tolerance in (1e-4, 1e-8):
        assert b.kernel("auto", tolerance, 0.0, 1).counts["transitions"] == transitions


#: CVODE and ARKODE, root directions and plain roots.
QUICK = [("cvode_bdf", native.DIRECTED), ("cvode_adams", native.PLAIN), ("erk_ARKODE_FEHLBERG_13_7_8", native.DIRECTED),
         ("erk_5", native.PLAIN), ("dirk_ARKODE_KVAERNO_7_4_5", native.DIRECTED), ("dirk_4", native.PLAIN)]  # fmt: skip


@pytest.mark.parametrize("name", ["three_bar/50", "three_bar_nsh/500"])
def test_sundials_solves_the_same_problem(tools, tmp_path, name):
    """SUNDIALS, our other witness, converges to our reference; where it is missing, the tool names the package."""
    b = bench(name, tools, tmp_path)
    if tools.sundials is None:
        assert "libsundials-dev" in toolchain.MISSING
        assert native.sundials_ladders(b) == []
        return
    exact, _ = work_precision.reference(b)
    for method, events in QUICK:
        loose, tight = (b.run(method, b.model, tolerance, events, 1, 20.0) for tolerance in (1e-6, 1e-11))
        assert error(tight, exact, b.problem) < min(1e-8, 0.1 * error(loose, exact, b.problem)), method
        assert tight.counts["transitions"] == exact.counts["transitions"], method


def test_missing_sundials_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(toolchain, "_sundials_version", lambda compiler: None)
    monkeypatch.setattr(toolchain, "_compile", lambda command: None)
    tools = toolchain.build(tmp_path)
    assert tools.sundials is None
    assert "libsundials-dev" in capsys.readouterr().out


def test_quick_run_writes_page_figure_and_data(tmp_path, monkeypatch):
    monkeypatch.setattr(work_precision.os, "sched_setaffinity", lambda *_: None, raising=False)
    arguments = ["--quick", "--problems", "three_bar/500", "--peers", "scipy", "--output", str(tmp_path)]
    work_precision.main(arguments)
    page, found = tmp_path / "work-precision.md", data.load(tmp_path / "work_precision.json")
    auto = data.fastest(found["rows"], "three_bar/500", **data.AUTO)
    scipy = data.fastest(found["rows"], "three_bar/500", **data.SCIPY)
    assert auto["transitions"] == 8 and scipy["error"] <= data.TARGET
    assert f"**{scipy['ms_per_s'] / auto['ms_per_s']:.3g}**" in page.read_text()
    png, first = tmp_path / "figures" / "work_precision_three_bar.png", page.read_text()
    drawn = png.read_bytes()
    work_precision.main(["--redraw", "--output", str(tmp_path)])
    assert page.read_text() == first and png.read_bytes() == drawn


def test_a_contender_stops_where_it_takes_too_long():
    calls = []

    def measure(setting, repetitions, limit):
        calls.append(setting)
        return Run([0.1], failure=None if setting > 1e-5 else too_long(limit))

    entries = work_precision.climb(Ladder("scipy", "RK45", True, "tolerance", (1e-3, 1e-4, 1e-5, 1e-6), measure), 1.0, 1)
    assert calls == [1e-3, 1e-4, 1e-5] and entries[-1].run.failure == "took longer than 1 s"


def test_nsh_costs_are_told_apart():
    duration, transitions = np.array([0.5, 1.0, 2.0, 1.0]), np.array([3.0, 26.0, 30.0, 8.0])
    per_second, per_transition, residual = nsh.fit(duration, transitions, 2e-4 * duration + 5e-6 * transitions)
    assert (per_second, per_transition) == pytest.approx((2e-4, 5e-6))
    assert residual < 1e-12
    assert nsh.fit(duration, transitions, 1.1e-4 * duration + np.array([1, -1, 1, -1]) * 1e-5)[2] > 0.01


def test_front_keeps_what_nothing_beats():
    rows = [{"error": e, "ms_per_s": t} for e, t in ((1e-3, 1.0), (1e-6, 2.0), (1e-5, 3.0), (1e-9, 4.0), (None, 0.5))]
    assert data.front(rows) == [(1e-3, 1.0), (1e-6, 2.0), (1e-9, 4.0)]


def test_data_come_back_as_they_were_saved(tmp_path):
    row = dict.fromkeys(data.COLUMNS) | {"problem": "p", "family": "scipy", "method": "RK45", "events": True, "kind": "tolerance"}
    rows = [row | {"setting": 1e-3, "failure": "took longer than 1 s"}, row | {"setting": 1e-4, "failure": "took longer than 1 s"}]
    data.save({"machine": {}, "rows": rows}, tmp_path / "x.json")
    assert data.load(tmp_path / "x.json") == {"machine": {}, "rows": rows}


def test_missing_data_are_named(tmp_path):
    with pytest.raises(SystemExit, match="work_precision.json is missing"):
        work_precision.main(["--redraw", "--output", str(tmp_path)])
