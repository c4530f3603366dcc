"""The page of importers comes from its data, and the runner judges what drivers hand back.  No tool is installed here."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.importers import run, scenario
from benchmarks.importers.environments import last_words
from benchmarks.importers.tools import TOOLS, Tool

ROOT = Path(__file__).resolve().parents[2]
ENDS_BADLY = """
import sys, json
json.dump({"rows": [], "first": 0, "note": ""}, open(sys.argv[1], "w"))
sys.exit(3)
"""
DATA = json.loads((ROOT / "docs" / "importers.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def expected():
    model = scenario.model()
    positions = np.tile(model.nodes, (4, 1, 1))
    return run.Expected(model, positions, positions + 1e-9)


def test_page_is_rendered_from_its_data():
    assert (ROOT / "docs" / "importers.md").read_text(encoding="utf-8") == run.report(DATA)


def test_every_tool_that_was_installed_takes_the_native_fmu():
    outcomes = {}
    for row in DATA["rows"]:
        if row["runtime"].startswith("native") and row["outcome"] != "not installed":
            outcomes.setdefault(row["tool"], []).append(row["outcome"])
    assert len(outcomes) >= 10
    assert all("passed" in found for found in outcomes.values()), outcomes
    assert {row["tool"] for row in DATA["rows"]} == {tool.name for tool in TOOLS}


def test_drivers_exist_and_are_python():
    for tool in TOOLS:
        if tool.driver:
            ast.parse((run.DRIVERS / f"{tool.driver}.py").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "shift, first, outcome", [(0.0, 0, "passed"), (0.0, 1, "passed"), (1e-6, 0, "differs"), (np.nan, 0, "differs")]
)
def test_rows_are_compared_with_reference_and_kernel(expected, shift, first, outcome):
    rows = (expected.reference[first:] + shift).reshape(4 - first, -1).tolist()
    found = run.judged({"rows": rows, "first": first, "note": ""}, expected, "")
    assert found["outcome"] == outcome
    np.testing.assert_allclose([found["deviation"], found["from_kernel"]], [shift, abs(shift - 1e-9)], atol=1e-13)


def test_missing_rows_are_a_difference(expected):
    rows = expected.reference[:3].reshape(3, -1).tolist()
    assert run.judged({"rows": rows, "first": 0, "note": ""}, expected, "")["outcome"] == "differs"


def test_checkers_hand_back_no_rows(expected):
    assert run.judged({"rows": [], "first": 0, "note": ""}, expected, "")["outcome"] == "passed"


@pytest.mark.parametrize(
    "code, outcome, why",
    [
        ("raise SystemExit('Error: it said no')", "refused", "it said no (exit code 1)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "refused", "killed by signal 9"),
        (ENDS_BADLY, "passed", "ended with 3"),
    ],
)
def test_a_driver_that_fails_is_a_row(code, outcome, why, expected, tmp_path):
    found = run.outcome([sys.executable, "-c", code, str(tmp_path / "result.json")], tmp_path, None, expected)
    assert found["outcome"] == outcome and why in found["why"]


def test_a_tool_that_cannot_be_had_is_a_row(expected, monkeypatch, tmp_path):
    def missing(*_):
        raise run.environments.Missing("nobody has it")

    monkeypatch.setattr(run.environments, "python_of", missing)
    found = run.one(Tool("nothing", ("nothing==1",), "fmpy_calls"), tmp_path, tmp_path, expected)
    assert found == {"version": "", "outcome": "not installed", "why": "nobody has it"}


def test_last_words_pass_over_the_stack_of_java():
    assert last_words("Exception: no\n\tat org.Main.main(Main.java:1)\n") == "Exception: no"


def test_fmpy_drives_the_native_fmu_as_a_driver_does(tmp_path):
    """The one driver whose tool is here anyway: from job to verdict."""
    model = scenario.model()
    fmu = scenario.PACK["native"](model, tmp_path / f"{model.name}.fmu")
    kernel = scenario.plain_kernel(model)
    (tmp_path / "job.json").write_text(
        json.dumps(scenario.job(model, fmu, fmu, tmp_path) | {"coupled": False}), encoding="utf-8"
    )
    driver = run.DRIVERS / "fmpy_calls.py"
    subprocess.run([sys.executable, str(driver), "job.json", "result.json"], cwd=tmp_path, check=True)
    found = run.judged(json.loads((tmp_path / "result.json").read_bytes()), run.Expected(model, kernel, kernel), "")
    assert found["outcome"] == "passed" and found["deviation"] < 1e-11
