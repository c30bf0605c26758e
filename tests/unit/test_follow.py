"""How soon what a device says is felt by the arm: within one period and one tick, whatever it says and whenever."""

import pytest

from operators.command_path import (
    BOUND_TICKS,
    FORMS,
    PERIOD_TICKS,
    VIRTUAL_PERIODS,
    pushes,
    ticks_to_torque,
    undisturbed,
)

CASES = [pushes()[0], pushes()[5], pushes()[11], pushes()[14]]


@pytest.fixture(scope="module")
def calm():
    return undisturbed(VIRTUAL_PERIODS)


def test_without_bytes_the_same_run_is_the_same_to_the_bit(calm):
    assert undisturbed(VIRTUAL_PERIODS).tobytes() == calm.tobytes()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("phase", range(PERIOD_TICKS))
def test_bytes_change_the_torque_within_a_period_and_a_tick(calm, form, phase):
    ticks = [ticks_to_torque(counts, form, phase, calm) for counts in CASES]
    assert max(ticks) <= BOUND_TICKS
    # Nobody knows what a device will say: never in the tick in which it is said, nor in those before.
    assert min(ticks) >= 1


def test_the_longest_wait_is_that_of_bytes_that_came_just_after_a_period_began(calm):
    waits = [ticks_to_torque(CASES[0], "whole", phase, calm) for phase in range(PERIOD_TICKS)]
    assert waits == sorted(waits, reverse=True)
    assert len(set(waits)) == PERIOD_TICKS
