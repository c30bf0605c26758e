from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.episode import Stream
from wrenchflow.errors import ConfigError
from wrenchflow.filtering import zero_phase
from wrenchflow.process.calibration import Bias
from wrenchflow.process.config import ContactConfig
from wrenchflow.process.contact import find_contacts, in_contact
from wrenchflow.process.onset import refine_onsets
from wrenchflow.process.thresholds import Thresholds
from wrenchflow.rig import load_rig
from wrenchflow.signals import FORCE, WRENCH

RIG = load_rig("panda_peg")

THRESHOLDS = Thresholds(on_n=2.0, off_n=1.0, on_nm=None, off_nm=None, noise_n=0.1, noise_nm=None, min_dwell_s=0.02)


def force(*parts: tuple[float, int], t: np.ndarray | None = None) -> Stream:
    """Force along x, as (value [N], samples) parts at 1 kHz."""
    values = np.concatenate([np.full(count, value) for value, count in parts])
    data = np.column_stack([values, np.zeros((len(values), 2))])
    stamps = np.arange(len(values), dtype=np.int64) * 1_000_000 if t is None else t
    return Stream(stamps, data, FORCE, "base")


def spans_ms(stream: Stream, thresholds: Thresholds = THRESHOLDS) -> list[tuple[int, int]]:
    return [(e.start_ns // 1_000_000, e.stop_ns // 1_000_000) for e in find_contacts(stream, 1000.0, thresholds)]


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
    contacts = find_contacts(stream, 1000.0, THRESHOLDS)
    norm = np.linalg.norm(stream.data, axis=1)
    for event in contacts:
        inside = in_contact(stream, (event,))
        assert inside.sum() >= 20
        assert norm[inside].max() >= THRESHOLDS.on_n
    for before, after in pairwise(contacts):
        assert after.start_ns - before.stop_ns >= 20_000_000
    # A contact that is found is found again: segmentation of the same force is a function of it.
    assert find_contacts(stream, 1000.0, THRESHOLDS) == contacts


def test_a_moment_alone_is_contact_until_both_are_gone():
    moment = {"on_nm": 0.2, "off_nm": 0.1, "noise_nm": 0.01}
    thresholds = replace(THRESHOLDS, **moment)
    data = np.zeros((300, 6))
    data[50:150, 4], data[140:200, 0] = 0.3, 1.5
    stream = Stream(np.arange(300, dtype=np.int64) * 1_000_000, data, WRENCH, "base")
    assert spans_ms(stream, thresholds) == [(50, 200)]
    data[:, 4] = 0.0
    assert spans_ms(replace(stream, data=data), thresholds) == []


@pytest.mark.parametrize(("on_n", "off_n"), [(1.0, 2.0), (1.0, 1.0), (2.0, 0.0)])
def test_impossible_thresholds_are_refused(on_n: float, off_n: float):
    with pytest.raises(ConfigError, match="0 < off_n < on_n"):
        ContactConfig(on_n=on_n, off_n=off_n)
    with pytest.raises(ConfigError, match="set together"):
        ContactConfig(on_n=on_n)
    with pytest.raises(ConfigError, match="min_dwell_s"):
        ContactConfig(min_dwell_s=-1.0)


def quiet(sigma_n: float, seed: int = 0) -> Stream:
    data = np.random.default_rng(seed).normal(0, sigma_n, (1000, 6)) * [1, 1, 1, 0.02, 0.02, 0.02]
    return Stream(np.arange(1000, dtype=np.int64) * 1_000_000, data, WRENCH, "base")


def of(labels: Stream, config: ContactConfig, left: str = "") -> Thresholds:
    width = labels.signal.width
    bias = Bias(
        mean=np.zeros(width),
        std=np.zeros(width),
        slope_per_min=np.zeros(width),
        start_ns=0,
        stop_ns=10**9,
        samples=1000,
    )
    return Thresholds.of(labels, RIG, bias, config, left)


def test_thresholds_grow_with_the_noise_that_is_there_and_with_inertia_that_is_left():
    calm, loud = of(quiet(0.05), ContactConfig()), of(quiet(0.5), ContactConfig())
    assert calm.noise_n == pytest.approx(0.05 * np.sqrt(3), rel=0.05)
    assert loud.on_n - calm.on_n == pytest.approx(6.0 * 0.45 * np.sqrt(3), rel=0.05)
    assert calm.off_n == pytest.approx(calm.on_n / 2)
    assert of(quiet(0.05), ContactConfig(), "nobody knows the twist").on_n > calm.on_n
    assert calm.on_nm is not None
    assert calm.on_nm > 6.0 * 0.001 * np.sqrt(3)
    three = quiet(0.05)
    three = Stream(three.t, three.data[:, :3].copy(), FORCE, "base")
    assert of(three, ContactConfig()).on_nm is None


def test_thresholds_by_hand_within_the_noise_are_refused():
    assert of(quiet(0.1), ContactConfig(on_n=3.0, off_n=1.0)).on_n == 3.0
    with pytest.raises(ConfigError, match=r"contact.off_n must stand above the noise .* got 0.3, expected 0\.5"):
        of(quiet(0.1), ContactConfig(on_n=3.0, off_n=0.3))


@pytest.mark.parametrize(("kind", "usual_ms", "worst_ms"), [("blow", 1, 3), ("ramp", 4, 20), ("soft", 9, 30)])
def test_an_onset_is_found_to_some_samples(kind: str, usual_ms: float, worst_ms: float):
    """Of a push that is known, under noise; its first sample is number 1000."""
    step = np.maximum(np.arange(2000) - 999.0, 0.0)
    force_n = {"blow": np.minimum(step, 1.0) * 8.0, "ramp": step * 0.05, "soft": 2e-3 * step**2}[kind]
    t = np.arange(2000, dtype=np.int64) * 1_000_000
    thresholds = replace(THRESHOLDS, on_n=0.6, off_n=0.3, noise_n=0.05)
    off_ms = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        push = np.eye(3)[seed % 3] * rng.choice([-1.0, 1.0])
        data = np.minimum(force_n, 10.0)[:, None] * push + rng.normal(0, 0.1, (2000, 3))
        unfiltered = Stream(t, data, FORCE, "base")
        labels = replace(unfiltered, data=zero_phase(data, 40.0, 1000.0))
        found = find_contacts(labels, 1000.0, thresholds)
        (contact,) = refine_onsets(found, unfiltered, labels, thresholds, 1000.0, 0.0)
        assert contact.stop_ns == found[0].stop_ns
        off_ms.append(abs(contact.start_ns - int(t[1000])) * 1e-6)
    assert np.median(off_ms) <= usual_ms
    assert max(off_ms) <= worst_ms


def test_no_samples_have_no_contacts():
    assert spans_ms(force((0, 0))) == []
