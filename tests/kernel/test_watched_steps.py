"""Steps that somebody watches: looking changes no bit, a step ends early where its watcher says so, and the parts of a
step make the whole.

The sequences are seeded: `python -m tests.kernel.test_watched_steps COUNT` runs COUNT of them for each scene and method.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Transition
from tests.kernel.test_refused_calls import MODELS
from tests.support.words import words

H, STEPS = 0.01, 10
ENERGIES = ("kinetic", "potential", "elastic", "dissipated")
FIXED = ("rk4", "ros2")


def made(name: str, method: str) -> Kernel:
    settings = {"max_step": 1e-4} if method in FIXED else {"tolerance": 1e-9}
    kernel = Kernel(MODELS[name](), method=method, **settings)
    kernel.initialize(0.25)
    return kernel


def driven(kernels: list[Kernel], random: np.random.Generator, step: int) -> None:
    """Forces that jump at every third step; rest lengths that move from the fourth on, but where motors move them."""
    if step % 3:
        return
    shape = kernels[0]["rest_length_rate"].shape
    force, rate = 20.0 * random.normal(size=len(kernels[0]["force"])), 0.01 * random.normal(size=shape)
    for kernel in kernels:
        kernel["force"][:] = force
        kernel["rest_length_rate"][:] = rate if step and not kernel.counts["A"] else 0.0


def carried(kernel: Kernel, h: float) -> None:
    """What a host does with a rest length that it moves."""
    kernel["rest_length"][:] += h * kernel["rest_length_rate"]


def balance(kernel: Kernel) -> float:
    """Energy that is there or was dissipated, less what came in, J: constant."""
    return sum(kernel[name][0] for name in ENERGIES) - kernel["input_work"][0]


def watch_and_compare(name: str, method: str, seed: int, steps: int) -> int:
    """A watched kernel and one that is not, every look taken; returns how many moments there were."""
    plain, watched = made(name, method), made(name, method)
    random, moments = np.random.default_rng(seed), 0

    def watcher(crossed: bool) -> None:
        nonlocal moments
        moments += 1
        watched.look()
        outputs = watched.values.copy()
        watched.output_rates()
        np.testing.assert_array_equal(watched.values, outputs)

    for step in range(steps):
        driven([plain, watched], random, step)
        plain.step(H)
        assert watched.watched_step(H, watcher) == H
        assert watched.save() == plain.save() and watched.transitions == plain.transitions
        np.testing.assert_array_equal(watched.values, plain.values)
        for kernel in (plain, watched):
            carried(kernel, H)
    return moments


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MODELS)
def test_looking_changes_no_bit(name, method):
    assert watch_and_compare(name, method, 1, STEPS) > 0


def in_parts(kernel: Kernel, h: float, ends: Callable[[bool], bool]) -> tuple[int, list[Transition]]:
    """A step in as many calls as it takes; returns how many they were, and their transitions."""
    end, left, count, found = kernel.time + h, h, 0, []
    while left > 0.0:
        before = kernel.time
        done = kernel.watched_step(left, ends)
        found += kernel.transitions
        carried(kernel, done)
        assert before < kernel.time and 0.0 < done <= left
        assert all(before <= t.time <= kernel.time for t in kernel.transitions)
        left = end - kernel.time if done < left else 0.0
        count += 1
    assert abs(kernel.time - end) <= np.spacing(end)
    return count, found


def parts_and_whole(name: str, method: str, seed: int, steps: int) -> np.ndarray:
    """The same motion in whole steps, and in parts that end at each transition and at one in four of the internal steps;
    returns how many transitions and parts there were."""
    whole, parts = made(name, method), made(name, method)
    random, start = np.random.default_rng(seed), balance(whole)
    room, drift = (2e-5, 2e-2) if method in FIXED else (5e-9, 1e-7)  # m, J
    counts = np.zeros(2, dtype=int)
    for step in range(steps):
        driven([whole, parts], random, step)
        whole.step(H)
        count, found = in_parts(parts, H, lambda crossed: crossed or random.random() < 0.25)
        assert abs(parts.time - whole.time) <= 1e-16 * (step + 2)
        kinds = [sorted((t.string, t.before, t.after) for t in told) for told in (found, whole.transitions)]
        assert kinds[0] == kinds[1]
        np.testing.assert_allclose(parts["position"], whole["position"], rtol=0, atol=room)
        assert abs(balance(parts) - start) < drift and abs(balance(whole) - start) < drift
        carried(whole, H)
        parts["rest_length"][:] = whole["rest_length"]
        counts += [len(found), count]
    return counts


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MODELS)
def test_the_parts_of_a_step_make_the_whole(name, method):
    transitions, parts = parts_and_whole(name, method, 1, STEPS)
    assert transitions > 0 and parts > STEPS


def first_transition(kernel: Kernel) -> float:
    """Steps under a load until one ends at a transition; returns how far that one went."""
    kernel["force"][2::3] = -60.0
    for _ in range(100):
        done = kernel.watched_step(H, lambda crossed: crossed)
        if done < H:
            return done
    raise AssertionError("no transition")


def test_a_step_ends_at_its_first_transition_and_goes_on_from_there():
    """The state is on the new piece, and complete; the next step does not find the same transition again."""
    kernel, other = made("three_bar_nsh", "auto"), made("three_bar_nsh", "auto")
    first_transition(kernel)
    crossed = {(t.string, t.before, t.after) for t in kernel.transitions}
    assert crossed and {t.time for t in kernel.transitions} == {kernel.time}
    saved, values = kernel.save(), kernel.values.copy()
    other.restore(saved)
    assert other.time == kernel.time and other.save() == saved
    np.testing.assert_array_equal(other.values, values)
    for one in (kernel, other):
        one.step(H)
        assert not crossed & {(t.string, t.before, t.after) for t in one.transitions}
    assert kernel.save() == other.save()


def test_what_a_watcher_sees_is_where_the_step_can_end():
    """Time, transitions, outputs and their derivatives."""
    kernel, ended = made("three_bar_nsh", "auto"), made("three_bar_nsh", "auto")
    for one in (kernel, ended):
        one["force"][2::3] = -60.0
    seen = []

    def watcher(crossed: bool) -> None:
        kernel.look()
        rates = kernel.output_rates()
        seen.append((crossed, kernel.time, kernel.values[kernel.first_output :].copy(), rates, kernel.transitions))

    while not any(crossed for crossed, *_ in seen):
        before = kernel.save()
        seen.clear()
        kernel.watched_step(H, watcher)
    for n, (_, time, outputs, rates, transitions) in enumerate(seen):
        ended.restore(before)
        going_on = iter([False] * n)
        done = ended.watched_step(H, lambda crossed, going_on=going_on: next(going_on, True))
        assert done < H and ended.time == time and ended.transitions == transitions
        np.testing.assert_array_equal(ended.values[ended.first_output :], outputs)
        np.testing.assert_allclose(ended.output_rates(), rates, rtol=1e-6, atol=1e-6)


def refused(kernel: Kernel, call: Callable[[], object]) -> Callable[[bool], None]:
    """A watcher that makes a call and expects that it is refused."""

    def watcher(crossed: bool) -> None:
        with pytest.raises(InputError, match="a step is under way"):
            call()

    return watcher


CALLS = {
    "step": lambda kernel, state: kernel.step(H),
    "watched_step": lambda kernel, state: kernel.watched_step(H, lambda crossed: False),
    "initialize": lambda kernel, state: kernel.initialize(),
    "reset": lambda kernel, state: kernel.reset(),
    "save": lambda kernel, state: kernel.save(),
    "restore": lambda kernel, state: kernel.restore(state),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_watcher_may_only_look(call):
    kernel, plain = made("two_bar", "auto"), made("two_bar", "auto")
    state = kernel.save()
    kernel.watched_step(H, refused(kernel, lambda: CALLS[call](kernel, state)))
    plain.step(H)
    assert kernel.save() == plain.save()


def test_only_a_watcher_may_look():
    with pytest.raises(InputError, match="only the watcher of a step may look"):
        made("two_bar", "auto").look()


def changed_input(kernel: Kernel) -> None:
    kernel["force"][0] += 1.0


def changed_slope(kernel: Kernel) -> None:
    kernel.slopes[0, 0] = 1.0


def changed_parameter(kernel: Kernel) -> None:
    kernel["stiffness"][0] *= 1.1


def changed_method(kernel: Kernel) -> None:
    kernel["method"][0] = 3


@pytest.mark.parametrize("change", [changed_input, changed_slope, changed_parameter, changed_method])
def test_inputs_and_parameters_stay_while_a_step_is_under_way(change):
    """Else the step is undone and they are as they were; the outputs, too, although the watcher looked."""
    kernel = made("two_bar", "auto")
    kernel.step(H)
    kernel["force"][1] = 5.0
    state, values = kernel.save(), kernel.values.copy()

    def watcher(crossed: bool) -> None:
        kernel.look()
        change(kernel)

    with pytest.raises(InputError, match="must not change while a step is under way"):
        kernel.watched_step(H, watcher)
    assert kernel.save() == state
    np.testing.assert_array_equal(kernel.values, values)


def test_a_step_whose_watcher_raises_is_undone():
    kernel, plain = made("two_bar", "auto"), made("two_bar", "auto")

    def watcher(crossed: bool) -> None:
        kernel.look()
        raise KeyError("mine")

    state, values = kernel.save(), kernel.values.copy()
    with pytest.raises(KeyError, match="mine"):
        kernel.watched_step(H, watcher)
    assert kernel.save() == state
    np.testing.assert_array_equal(kernel.values, values)
    for one in (kernel, plain):
        one.step(H)
    assert kernel.save() == plain.save()


def test_a_part_that_fails_keeps_the_last_good_state():
    """After a step that ended early; outputs that the watcher filled before the failure are those of that end again."""
    kernel = made("three_bar_nsh", "auto")
    done = first_transition(kernel)
    state, values = kernel.save(), kernel.values.copy()
    kernel["force"][0] = 1e300
    with pytest.raises(SimulationError):
        kernel.watched_step(H - done, lambda crossed: kernel.look())
    kernel["force"][:] = values[kernel.layout["force"]]
    assert kernel.save() == state
    np.testing.assert_array_equal(kernel.values, values)


if __name__ == "__main__":
    (count,) = words(__doc__, int)
    moments, total = 0, np.zeros(2, dtype=int)
    for name in MODELS:
        for method in METHODS:
            for seed in range(count):
                moments += watch_and_compare(name, method, seed, STEPS)
                total += parts_and_whole(name, method, seed, STEPS)
    print(f"{moments} moments looked at; {total[0]} transitions, {total[1]} parts")
