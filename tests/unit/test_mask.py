"""A mask marks what was found, where and in which columns, and nothing else."""

import numpy as np

from wrenchflow.episode import Stream
from wrenchflow.process.anomalies import (
    consistency,
    duplicates,
    implausible,
    jumps,
    quaternions,
    saturation,
    spikes,
    stuck,
    timing,
    vibration,
)
from wrenchflow.process.anomalies.five_sigma import five_sigma
from wrenchflow.process.anomalies.mask import CODES, mask_of
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.finding import Finding
from wrenchflow.process.metrics.figure import GUARD_NS
from wrenchflow.process.pipeline import process_episode
from wrenchflow.signals import WRENCH

RAW = Stream(np.arange(100, dtype=np.int64) * 1_000_000, np.zeros((100, 6)), WRENCH, "sensor")


def finding(kind: str, first: int, last: int, *columns: str) -> Finding:
    span = {"start_ns": first * 1_000_000, "stop_ns": last * 1_000_000}
    return Finding(kind=kind, severity="warning", columns=columns, evidence="planted", **span)


def test_every_kind_has_a_code_of_its_own():
    kinds = {*consistency.KINDS, duplicates.KIND, implausible.KIND, jumps.KIND, quaternions.KIND, saturation.KIND}
    kinds |= {spikes.KIND, stuck.KIND, stuck.REPEATED, stuck.CONSTANT, vibration.KIND}
    kinds |= {timing.DROPOUT, timing.UNEVEN, timing.NOT_FINITE}
    assert kinds == set(CODES)
    assert len(set(CODES.values())) == len(CODES)
    assert 0 < min(CODES.values()) <= max(CODES.values()) < 256


def test_a_mask_marks_the_samples_and_columns_of_a_finding_and_no_others():
    mask = mask_of(RAW, [finding("spike", 10, 13, "fy"), finding("dropout", 50, 52), finding("no-contact", 0, 100)])
    assert mask is not None
    expected = np.zeros((100, 6))
    expected[10:13, 1], expected[50:52] = CODES["spike"], CODES["dropout"]
    np.testing.assert_array_equal(mask.data, expected)
    np.testing.assert_array_equal(mask.t, RAW.t)


def test_where_two_meet_the_worse_one_stands_whatever_the_order():
    both = [finding("not-finite", 5, 8, "fx"), finding("vibration", 0, 20, "fx", "fz")]
    for findings in (both, both[::-1]):
        mask = mask_of(RAW, findings)
        assert mask is not None
        assert (mask.data[5:8, 0] == CODES["not-finite"]).all()
        assert (mask.data[8:20, 0] == CODES["vibration"]).all()


def test_nothing_found_makes_no_mask():
    assert mask_of(RAW, []) is None
    assert mask_of(RAW, [finding("no-contact", 0, 100)]) is None


def test_the_mask_lies_beside_the_reading_which_stays_as_it_is(recording):
    raw = recording()
    data = raw["wrench_raw"].data.copy()
    data[1700, 2] += 40.0
    spiky = raw.with_stream("wrench_raw", Stream(raw["wrench_raw"].t, data, WRENCH, "sensor"))
    clean, assessment = process_episode(spiky, ProcessConfig())
    assert [each.kind for each in assessment.findings] == ["spike"]
    assert clean["wrench_raw"] == spiky["wrench_raw"]
    assert np.argwhere(clean["anomaly"].data).tolist() == [[1700, 2]]
    assert [event.label for event in clean.events_of("anomaly")] == ["spike"]


def test_five_sigma_tells_contact_where_no_detector_tells_a_fault(recording):
    raw = recording(push_n=(0.0, 3.0, -10.0))
    clean = clean_episode(raw, ProcessConfig()).episode
    labels, contacts = clean["wrench_zero_phase"], clean.events_of(CONTACT)
    flagged = five_sigma(labels, ~in_contact(labels, contacts, GUARD_NS)).any(axis=1)
    touching = in_contact(labels, contacts)
    assert flagged[touching].mean() > 0.95
    assert flagged[~in_contact(labels, contacts, GUARD_NS)].mean() < 0.01
    assert process_episode(raw, ProcessConfig())[1].findings == ()
