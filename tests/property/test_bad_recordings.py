"""Whatever is wrong with a recording, it is told: nothing crashes, nothing is invented, nothing is not a number."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.data_set import look_at_all
from wrenchflow.process.metric import NAMES
from wrenchflow.process.pipeline import look_at
from wrenchflow.process.report.episode_page import episode_page
from wrenchflow.process.report.folder_page import folder_page
from wrenchflow.process.table import as_json
from wrenchflow.signals import FORCE

RAW = "wrench_raw"
CONFIG = ProcessConfig()


@cache
def good() -> Episode:
    return demonstrate(0, CollectConfig(task="surface-wiping", operator="emulated", seed=5))


def values(episode: Episode, name: str, change) -> Episode:
    """One stream with its values changed in place."""
    stream = episode[name]
    data = stream.data.copy()
    change(data)
    return episode.with_stream(name, replace(stream, data=data))


def put(data: np.ndarray, rows, columns, value) -> None:
    data[rows, columns] = value


def first_rows(episode: Episode, name: str, count: int) -> Episode:
    stream = episode[name]
    return episode.with_stream(name, replace(stream, t=stream.t[:count], data=stream.data[:count]))


def without(episode: Episode, *names: str) -> Episode:
    return replace(episode, streams={name: each for name, each in episode.streams.items() if name not in names})


def three_columns(episode: Episode) -> Episode:
    raw = episode[RAW]
    return episode.with_stream(RAW, Stream(raw.t, raw.data[:, :3].copy(), FORCE, raw.frame))


def stretched(episode: Episode) -> Episode:
    """As of a clock that runs unevenly."""
    raw = episode[RAW]
    steps = np.random.default_rng(0).integers(200_000, 3_000_000, len(raw))
    return episode.with_stream(RAW, replace(raw, t=raw.t[0] + np.cumsum(steps)))


# Each with what must be told of it, if it is by itself: a finding, or something that cannot be assessed.
DAMAGE = {
    "nothing": (lambda e: e, set()),
    "a run of NaN": (lambda e: values(e, RAW, lambda d: put(d, slice(3000, 3100), 2, np.nan)), {"not-finite"}),
    "all NaN": (lambda e: values(e, RAW, lambda d: put(d, slice(None), 0, np.nan)), {"not-finite", "no-clean-force"}),
    "an infinity": (lambda e: values(e, RAW, lambda d: put(d, 4000, 1, np.inf)), {"not-finite"}),
    "a constant channel": (lambda e: values(e, RAW, lambda d: put(d, slice(None), 3, 0.25)), {"constant"}),
    "all zero": (lambda e: values(e, RAW, lambda d: put(d, slice(None), slice(None), 0.0)), {"constant"}),
    "no samples": (lambda e: first_rows(e, RAW, 0), {"no-clean-force", "max_force"}),
    "one sample": (lambda e: first_rows(e, RAW, 1), {"no-clean-force", "rate_hz"}),
    "two samples": (lambda e: first_rows(e, RAW, 2), {"no-clean-force", "max_force"}),
    "no wrench": (lambda e: without(e, RAW), {"no-clean-force", "anomalies", "samples"}),
    "no pose": (lambda e: without(e, "tcp_pose"), {"no-clean-force", "wrong-sign"}),
    "no joints": (lambda e: without(e, "joint_states", "external_torque"), {"wrong-sign", "work_joints_j"}),
    "no twist": (lambda e: without(e, "tcp_twist"), {"work_wrench_j"}),
    "no rig": (lambda e: replace(e, meta={}), {"no-clean-force", "anomalies"}),
    "a rig of nonsense": (lambda e: e.with_meta(rig={"robot": 3}), {"no-clean-force", "anomalies"}),
    "loaded from the start": (
        lambda e: values(e, RAW, lambda d: np.add(d, [0, 0, 25.0, 0, 0, 0], out=d)),
        {"no-clean-force", "always-loaded"},
    ),
    "quaternions of length 2": (
        lambda e: values(e, "tcp_pose", lambda d: put(d, slice(None), slice(3, 7), 1.0)),
        {"no-clean-force"},
    ),
    "a pose of NaN": (lambda e: values(e, "tcp_pose", lambda d: put(d, slice(500, 900), 0, np.nan)), set()),
    "a force of 1e6 N": (lambda e: values(e, RAW, lambda d: put(d, slice(5000, 5050), 2, 1e6)), {"implausible"}),
    "a force of 1e300 N": (lambda e: values(e, RAW, lambda d: put(d, 5000, 2, 1e300)), {"implausible"}),
    "millinewtons": (lambda e: values(e, RAW, lambda d: np.multiply(d, 1e3, out=d)), {"no-clean-force", "implausible"}),
    "three columns": (three_columns, {"snr_torque_db", "max_torque"}),
    "another frame": (lambda e: e.with_stream(RAW, replace(e[RAW], frame="world")), {"no-clean-force"}),
    "an uneven clock": (stretched, {"uneven", "no-clean-force"}),
    "a tare after the end": (
        lambda e: replace(e, events=(Event(e.span_ns[1] + 10**9, e.span_ns[1] + 2 * 10**9, "phase", "tare"),)),
        {"no-clean-force"},
    ),
    "no events": (lambda e: replace(e, events=()), set()),
    "a joint that moves in the tare": (
        lambda e: values(e, "joint_states", lambda d: put(d, slice(0, 800), 9, 0.3)),
        {"no-clean-force"},
    ),
}


def told(episode: Episode) -> set[str]:
    """What is said of an episode, in all the ways in which it is said, each looked at for what must not be there."""
    clean, assessment = look_at(episode, CONFIG)
    assert (clean is None) == bool(assessment.refused)
    assert set(assessment.values) == set(NAMES)
    reasons = {each.kind: each.reason for each in assessment.not_assessed}
    assert {name for name, value in assessment.values.items() if value is None} == set(reasons) & set(NAMES)
    assert all(reasons.values())
    assert all(finding.evidence and finding.start_ns <= finding.stop_ns for finding in assessment.findings)
    quality = look_at_all([assessment, replace(assessment, id="again")])
    json.dumps(as_json(quality), allow_nan=False)
    for page in (episode_page(assessment, episode, clean, CONFIG), folder_page(quality, CONFIG)):
        assert page.endswith("</html>\n")
    if clean is not None:
        assert np.isfinite(clean["wrench"].data).all()
        assert np.isfinite(clean["wrench_zero_phase"].data).all()
    return {finding.kind for finding in assessment.findings} | set(reasons)


@pytest.mark.parametrize("name", DAMAGE)
def test_each_damage_is_told(name):
    damage, expected = DAMAGE[name]
    assert expected <= told(damage(good())), name


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(sorted(DAMAGE)), min_size=2, max_size=4))
def test_damage_on_damage_is_told_too(names):
    episode = good()
    for name in names:
        if RAW not in episode or "tcp_pose" not in episode:
            break
        try:
            episode = DAMAGE[name][0](episode)
        except (IndexError, ValueError):  # The place that would be damaged is gone.
            continue
    told(episode)
