from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.episode import Stream
from wrenchflow.errors import ConfigError
from wrenchflow.process.config import ContactConfig
from wrenchflow.process.contact import find_contacts, in_contact
from wrenchflow.rig import load_rig
from wrenchflow.signals import FORCE

RIG = load_rig("panda_peg")
CONFIG = ContactConfig(on_n=2.0, off_n=1.0, min_dwell_s=0.02)


def force(*parts: tuple[float, int], t: np.ndarray | None = None) -> Stream:
    """Force along x, as (value [N], samples) parts at 1 kHz."""
    values = np.concatenate([np.full(count, value) for value, count in parts])
    data = np.column_stack([values, np.zeros((len(values), 2))])
    stamps = np.arange(len(values), dtype=np.int64) * 1_000_000 if t is None else t
    return Stream(stamps, data, FORCE, "base")


def spans_ms(stream: Stream, config: ContactConfig = CONFIG) -> list[tuple[int, int]]:
    return [(e.start_ns // 1_000_000, e.stop_ns // 1_000_000) for e in find_contacts(stream, RIG, config)]


def test_contact_begins_at_the_upper_threshold_and_ends_below_the_lower():
    assert spans_ms(force((0, 100), (1.5, 50), (3, 50), (1.5, 50), (0.5, 100))) == [(150, 250)]


def test_between_the_thresholds_alone_there_is_no_contact():
    assert spans_ms(force((0.0, 50), (1.9, 200), (0.0, 50))) == []


def test_short_contacts_do_not_count_and_short_breaks_do_not_end_one():
    assert spans_ms(force((0, 50), (3, 19), (0, 50))) == []
    assert spans_ms(force((0, 50), (3, 20), (0, 50))) == [(50, 70)]
    assert spans_ms(force((0, 50), (3, 30), (0, 19), (3, 30), (0, 50))) == [(50, 129)]
    assert spans_ms(force((0, 50), (3, 30), (0, 20), (3, 30), (0, 50))) == [(50, 80), (100, 130)]


def test_a_contact_may_reach_over_an_end_but_not_over_a_gap():
    assert spans_ms(force((3, 50), (0, 50), (3, 50))) == [(0, 50), (100, 150)]
    t = np.r_[0:50, 80:130] * 1_000_000
    assert spans_ms(force((3, 100), t=t)) == [(0, 50), (80, 130)]


@given(st.integers(0, 10_000), st.floats(0.01, 5.0))
def test_contacts_are_apart_last_the_dwell_and_touch_the_upper_threshold(seed: int, roughness: float):
    steps = np.random.default_rng(seed).normal(0, roughness, (400, 3))
    stream = Stream(np.arange(400, dtype=np.int64) * 1_000_000, np.cumsum(steps, axis=0), FORCE, "base")
    contacts = find_contacts(stream, RIG, CONFIG)
    norm = np.linalg.norm(stream.data, axis=1)
    for event in contacts:
        inside = in_contact(stream, (event,))
        assert inside.sum() >= 20
        assert norm[inside].max() >= CONFIG.on_n
    for before, after in pairwise(contacts):
        assert after.start_ns - before.stop_ns >= 20_000_000
    # A contact that is found is found again: segmentation of the same force is a function of it.
    assert find_contacts(stream, RIG, CONFIG) == contacts


def test_thresholds_within_the_noise_are_refused():
    noisy = replace(RIG, sensor=replace(RIG.sensor, noise_force_n=0.5))
    with pytest.raises(ConfigError, match=r"above the noise of sensor 'wrist-6d': got 1 N, expected 1\.5 N"):
        find_contacts(force((0, 10)), noisy)


@pytest.mark.parametrize(("on_n", "off_n", "dwell_s"), [(1, 2, 0.02), (1, 1, 0.02), (2, 0, 0.02), (2, 1, -1)])
def test_impossible_thresholds_are_refused(on_n: float, off_n: float, dwell_s: float):
    with pytest.raises(ConfigError, match="0 < off_n < on_n"):
        ContactConfig(on_n=float(on_n), off_n=float(off_n), min_dwell_s=float(dwell_s))


def test_no_samples_have_no_contacts():
    assert spans_ms(force((0, 0))) == []
