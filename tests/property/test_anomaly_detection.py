"""Every kind of fault is found where it was planted, and nothing is found where none was, contact least of all."""

import numpy as np
import pytest

from force.planted import FAULTS, RAW
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.process.anomalies.detect import detect
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.metrics.figure import GUARD_NS
from wrenchflow.process.stamps import finite
from wrenchflow.rig import rig_of

UNWEIGHED = "wrong-payload"  # These demonstrations turn the tool too little to weigh it.


@pytest.fixture(scope="module", params=["peg-insertion", "surface-wiping", "connector-insertion"])
def demonstration(request):
    episode = demonstrate(0, CollectConfig(task=request.param, operator="emulated", seed=77))
    return episode, clean_episode(episode, ProcessConfig()).episode.events_of(CONTACT)


def found_in(episode, contacts):
    free = ~in_contact(finite(episode[RAW]), contacts, GUARD_NS)
    return detect(episode, rig_of(episode.meta, "it"), free)


def test_nothing_is_found_in_a_demonstration_with_contact(demonstration):
    episode, contacts = demonstration
    assert contacts
    findings, not_assessed = found_in(episode, contacts)
    assert findings == []
    assert [each.kind for each in not_assessed] == [UNWEIGHED]


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if kind != UNWEIGHED])
def test_what_was_planted_is_found_and_nothing_else(demonstration, kind):
    episode, contacts = demonstration
    planted = FAULTS[kind](episode, np.random.default_rng(1))
    findings, _ = found_in(planted, contacts)
    assert {each.kind for each in findings} == {kind}
    assert all(each.evidence and each.start_ns < each.stop_ns for each in findings)
