"""Whoever asks for whatever, at any place: I1 to I11 hold, and without a safeguard one of them does not."""

import numpy as np
import pytest

from safety.arena import Arena
from safety.packets import now_ns, wandering_plan
from safety.runs import all_runs, all_searches, run
from safety.scenarios import SCENARIOS, broken_without
from wrenchflow.control.plan import packet_of
from wrenchflow.control.safeguards import SAFEGUARDS

QUICK = {str(each): each for each in all_runs(70_000, 800, seed=0)}
SEARCHES = {str(each): each for each in all_searches(12_000, seed=0)}


@pytest.mark.parametrize("each", QUICK.values(), ids=QUICK)
def test_no_adversary_breaks_an_invariant(each):
    assert [str(finding) for finding in run(each).broken] == []


@pytest.mark.parametrize("each", SEARCHES.values(), ids=SEARCHES)
def test_no_input_that_a_search_finds_breaks_an_invariant(each):
    assert [str(finding) for finding in run(each).broken] == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(8))
def test_in_two_million_ticks_nothing_breaks(part):
    ticks, broken = 0, []
    for each in (*all_runs(225_000, 3000, seed=1000 * (part + 1)), *all_searches(25_000, seed=1000 * (part + 1))):
        outcome = run(each)
        ticks += outcome.ticks
        broken += [f"{each}: {finding}" for finding in outcome.broken]
    assert ticks >= 2_000_000 / 8
    assert broken == []


@pytest.mark.parametrize("safeguard", SAFEGUARDS)
def test_with_every_safeguard_all_holds_and_without_this_one_something_does_not(safeguard):
    whole, without = broken_without(safeguard)
    assert [str(finding) for finding in whole] == []
    assert without, f"nothing fails without '{safeguard}'"


def test_every_safeguard_has_a_scenario_and_no_other():
    assert set(SCENARIOS) == set(SAFEGUARDS)


def test_a_plan_gives_the_same_torques_in_one_packet_or_in_eight():
    """I11."""
    torques = []
    for parts in (1, 8):
        arena, rng = Arena("wall", 3), np.random.default_rng(3)
        for _ in range(8):
            packet = packet_of(wandering_plan(arena, rng))
            for k, some in enumerate(np.array_split(np.arange(packet["count"][0]), parts)):
                part = packet.copy()
                part["t_obs_ns"] += k
                part["count"] = len(some)
                for name in ("t", "x", "quat_wxyz", "K_lin", "K_rot", "damping_ratio", "wrench", "gripper"):
                    part[name][0, : len(some)] = packet[name][0, some]
                # The newest observation of all parts is still not of the future.
                assert arena.controller.accept(part, now_ns(arena) + 8) == "accepted"
            arena.run(70)
        torques.append(arena.log.trace.after["tau"].copy())
    assert torques[0].tobytes() == torques[1].tobytes()
    assert np.abs(np.diff(torques[0], axis=0)).max() > 0.0
