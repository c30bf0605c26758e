"""Leading by hand: whoever lands softly still feels that there is something, and begins to search."""

import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.profiles import PROFILES
from wrenchflow.collect.session import demonstrate

# Days on which the gentle person is slow, and rests on the block with 0.6 N.
SLOW_DAYS = (1, 7)


@pytest.mark.parametrize("index", SLOW_DAYS)
def test_a_gentle_person_does_not_stand_on_the_block_without_feeling_it(index):
    episode = demonstrate(index, CollectConfig(operator="hand-guided", profiles=("gentle",)))
    assert episode.meta["person"]["pace"] < 1.05 * PROFILES["gentle"].pace
    lasted = {"land": 0, "search": 0}
    for event in episode.events_of("phase"):
        if event.label in lasted:
            lasted[event.label] += event.stop_ns - event.start_ns
    assert lasted["search"] > 0
    assert lasted["land"] < 4e9
    assert episode.meta["result"]["success"]
