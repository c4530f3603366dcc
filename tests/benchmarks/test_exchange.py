"""Hosts in benchmarks/exchange: what the counting library tells, late events, and how transitions are compared."""

import platform
import sys

import pytest

from benchmarks.exchange import contenders, events, promise, run
from benchmarks.harness import problems
from tensegrity_core.model import Transition

PROBLEM = "two_bar_nsh/500"
NATIVE = sys.platform == "linux" and platform.machine() == "x86_64"


@pytest.fixture(scope="module")
def solved():
    """The problem, the judged nodes' positions and the number of transitions."""
    problem = problems.problem(PROBLEM)
    return (problem, *run.reference(problem))


@pytest.mark.skipif(not NATIVE, reason="the counting library is for Linux on x86-64")
@pytest.mark.parametrize("name", ["kernel", "careful"])
def test_calls_evaluations_and_transitions_are_counted(name, solved, tmp_path):
    problem, exact, transitions = solved
    (one,) = (one for one in contenders.CONTENDERS if one.name == name)
    rows = run.ladder(problem, one._replace(settings=(1e-4, 1e-7)), exact, tmp_path)
    assert [row["failure"] for row in rows] == [None, None] and rows[1]["error"] < 1e-6
    for row in rows:
        assert row["transitions"] == transitions and row["rhs"] > 50
        assert row["calls"] < 100 if name == "kernel" else row["calls"] > row["rhs"] + row["indicators"] + row["directional"]
    assert rows[0]["rhs"] < rows[1]["rhs"] and (rows[1]["events"] >= transitions // 2) == (name == "careful")


def test_an_event_that_is_seen_late_costs_accuracy(solved, tmp_path):
    problem, exact, transitions = solved
    found = events.curve(problem, exact, events.located, (1e-12, 1e-3), tmp_path)
    assert found["errors"][0] < 1e-9 and found["errors"][1] > 1000.0 * found["errors"][0]
    assert found["transitions"] == [transitions, transitions]
    slow = events.curve(problem, exact, events.stepped, (1e-3,), tmp_path)
    assert slow["errors"][0] is None or slow["errors"][0] > 1e-8


def test_transitions_are_compared_string_by_string():
    a, b = Transition(1.0, 0, 1, 2), Transition(1.0, 1, 1, 2)
    assert promise.same([a, b], [b, a])
    assert promise.same([a, b], [a, Transition(1.0 + 5e-7, 1, 1, 2)])
    assert not promise.same([a, b], [a, Transition(1.0 + 5e-6, 1, 1, 2)])
    assert not promise.same([a, b], [a]) and not promise.same([a], [Transition(1.0, 0, 1, 0)])
