"""What an emulated person does follows from what a policy sees; a person with a hidden mind is found out."""

from dataclasses import replace

import numpy as np
import pytest

from operators.explained import leads, moves, seen_of
from operators.whims import demonstrate_on_a_whim
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.policy.features import WITH_FORCE, Features

pytestmark = pytest.mark.slow  # A minute.
CONFIG = CollectConfig(operator="emulated")
# All people are in those that are learned from, and in the others.
EPISODES, LEARNED = 40, 30
# What is asked for 60 ms later, a step of a policy; and how it moves within a tenth of a second.
STEP, MOVE = 3, 5
CONTACT = ("land", "search", "insert")


@pytest.fixture(scope="module")
def seen(unchecked):
    with unchecked():
        return [seen_of(demonstrate(index, CONFIG)) for index in range(EPISODES)]


@pytest.fixture(scope="module")
def whims(unchecked):
    with unchecked():
        return [seen_of(demonstrate_on_a_whim(index, CONFIG)) for index in range(EPISODES)]


def test_the_regression_explains_what_follows_from_what_is_seen(seen):
    # A person who presses as hard as the peg's skill would, and goes where the moment says, seen exactly.
    features = Features(WITH_FORCE)
    wrench, mean = features.columns_of("wrench"), features.columns_of("wrench_mean")

    def remembers_nothing(each):
        felt, slow = each.observed[:, wrench], each.observed[:, mean]
        way = np.stack([slow[:, 4], -slow[:, 3]], axis=1) / np.maximum(np.hypot(slow[:, 3], slow[:, 4]), 0.01)[:, None]
        press = np.minimum(8.0, np.maximum(felt[:, 2], 0.0) + 3.0) / 600.0
        return replace(each, target=each.position + np.column_stack([0.002 * way, press]))

    exact = [remembers_nothing(each) for each in seen]
    for left in leads(exact[:LEARNED], exact[LEARNED:], 1).values():
        assert (left.share < 0.05).all(), str(left)


def test_little_of_what_a_person_wants_is_not_explained_by_what_is_seen(seen):
    left = leads(seen[:LEARNED], seen[LEARNED:], STEP)
    assert set(CONTACT) <= set(left)
    for phase in CONTACT:
        each = left[phase]
        assert each.steps > 100
        # A millimetre of lead is half a newton.
        assert (each.rms_m[:2] < 0.001).all(), f"{phase}: {each}"
        assert each.rms_m[2] < 0.002, f"{phase}: {each}"
        much = each.of_m > 0.0015
        assert (each.share[much] < 0.2).all(), f"{phase}: {each}"


def test_a_person_who_keeps_something_to_himself_is_found_out(seen, whims):
    open_, hidden = (moves(each[:LEARNED], each[LEARNED:], MOVE)["search"] for each in (seen, whims))
    # Along the press most of what a person does in a search has its reason in what is seen; a whim has none.
    assert open_.share[2] < 0.5, str(open_)
    assert hidden.share[2] > open_.share[2] + 0.15, f"{hidden}; without whims {open_}"
    assert hidden.rms_m[2] > 1.4 * open_.rms_m[2], f"{hidden}; without whims {open_}"
