"""Modes of contact: what a demonstration shows, and no label where nobody can tell."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.contact_modes import CONTACT_MODE, FREE, SEATED, SLIDING, TOUCH


def seconds(clean: Episode, mode: str, within: str = "") -> float:
    """How long a mode lasts, in a phase or in all of the episode."""
    spans = [(each.start_ns, each.stop_ns) for each in clean.events_of("phase") if each.label == within]
    spans = spans or [(-(2**62), 2**62)]
    events = [each for each in clean.events_of(CONTACT_MODE) if each.label == mode]
    return 1e-9 * sum(
        max(min(each.stop_ns, stop) - max(each.start_ns, start), 0) for each in events for start, stop in spans
    )


@pytest.fixture(scope="module")
def shown() -> dict[str, Episode]:
    names = ("surface-wiping", "connector-insertion")
    raw = {name: demonstrate(0, CollectConfig(task=name, operator="emulated", seed=77)) for name in names}
    return {name: clean_episode(episode, ProcessConfig()).episode for name, episode in raw.items()}


def test_a_wiper_slides_and_never_sits(shown):
    clean = shown["surface-wiping"]
    wiped = sum(1e-9 * (each.stop_ns - each.start_ns) for each in clean.events_of("phase") if each.label == "wipe")
    assert wiped > 1.0
    assert seconds(clean, SLIDING, "wipe") > 0.9 * wiped
    assert seconds(clean, SEATED) == 0.0
    assert seconds(clean, FREE, "approach") > 0.0


def test_a_plug_touches_and_ends_in_its_seat(shown):
    clean = shown["connector-insertion"]
    assert seconds(clean, TOUCH) > 0.1
    assert clean.events_of(CONTACT_MODE)[-1].label == SEATED


def test_modes_cover_the_force_once_and_free_is_where_no_contact_is(shown):
    for clean in shown.values():
        labels, modes = clean["wrench_zero_phase"], clean.events_of(CONTACT_MODE)
        assert all(after.start_ns == before.stop_ns for before, after in pairwise(modes))
        assert (modes[0].start_ns, modes[-1].stop_ns) == (int(labels.t[0]), int(labels.t[-1]) + 1_000_000)
        free = in_contact(labels, tuple(each for each in modes if each.label == FREE))
        np.testing.assert_array_equal(free, ~in_contact(labels, clean.events_of(CONTACT)))


def test_where_the_motion_is_not_known_contact_has_no_mode(shown):
    clean = shown["surface-wiping"]
    pose = clean["tcp_pose"]
    gap = (pose.t > pose.t[0] + 10**9) & (pose.t < pose.t[0] + 2 * 10**9)
    holey = replace(pose, t=pose.t[~gap], data=pose.data[~gap])
    streams = {name: stream for name, stream in clean.streams.items() if name != "tcp_twist"}
    again = clean_episode(replace(clean, streams=streams | {"tcp_pose": holey}), ProcessConfig()).episode
    assert {each.label for each in again.events_of(CONTACT_MODE)} == {FREE}
