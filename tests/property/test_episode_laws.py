"""Streams, events and episodes keep their own rules, never change, and travel between processes."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import StreamError
from wrenchflow.signals import FORCE, JOINTS, POSE, WRENCH, Signal

stamps = st.lists(st.integers(-(2**62), 2**62), max_size=30, unique=True).map(lambda t: np.array(sorted(t), np.int64))


def stream(t: np.ndarray, seed: int = 0) -> Stream:
    return Stream(t, np.random.default_rng(seed).normal(size=(len(t), 6)), WRENCH, "sensor")


@given(t=stamps, start=st.integers(-(2**62), 2**62), stop=st.integers(-(2**62), 2**62))
def test_between_takes_the_samples_of_a_half_open_interval(t, start, stop):
    whole = stream(t)
    part = whole.between(start, stop)
    wanted = (t >= start) & (t < stop)
    np.testing.assert_array_equal(part.t, t[wanted])
    np.testing.assert_array_equal(part.data, whole.data[wanted])
    assert (part.signal, part.frame) == (whole.signal, whole.frame)


@given(t=stamps.filter(len), cut=st.integers(-(2**62), 2**62))
def test_cut_in_two_nothing_is_lost_and_nothing_is_doubled(t, cut):
    whole = stream(t)
    parts = whole.between(int(t[0]), cut), whole.between(max(cut, int(t[0])), int(t[-1]) + 1)
    assert np.concatenate([part.t for part in parts]).tobytes() == t.tobytes()


@given(t=stamps.filter(lambda t: len(t) > 1), row=st.integers(1, 29))
def test_stamps_that_stand_still_are_refused(t, row):
    t[row % (len(t) - 1) + 1] = t[row % (len(t) - 1)]
    with pytest.raises(StreamError, match="strictly increase"):
        stream(t)


def test_a_stream_and_what_is_taken_of_it_cannot_be_written_to():
    t = np.arange(4, dtype=np.int64)
    whole = stream(t)
    for array in (whole.t, whole.data, whole.column("fz"), whole.between(0, 2).data):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    t[0] = -1  # What the caller keeps is the caller's.
    assert t.flags.writeable


@pytest.mark.parametrize(
    ("t", "data"),
    [
        (np.arange(3), np.zeros((2, 6))),
        (np.arange(3), np.zeros((3, 5))),
        (np.arange(3), np.zeros(18)),
        (np.arange(3).reshape(3, 1), np.zeros((3, 6))),
        (np.arange(3.0), np.zeros((3, 6))),
        (np.arange(3), np.zeros((3, 6), np.float32)),
        (np.arange(3, dtype=np.int32), np.zeros((3, 6))),
    ],
)
def test_wrong_shapes_and_types_are_refused(t, data):
    from jaxtyping import TypeCheckError

    with pytest.raises((StreamError, TypeCheckError)):
        Stream(t, data, WRENCH)


def test_streams_are_equal_by_their_bits():
    t = np.arange(3, dtype=np.int64)
    data = np.array([[0.0, np.nan, 1, 2, 3, 4]] * 3)
    assert Stream(t, data, WRENCH) == Stream(t.copy(), data.copy(), WRENCH)
    assert Stream(t, data, WRENCH) != Stream(t, np.where(data == 0.0, -0.0, data), WRENCH)
    assert Stream(t, data, WRENCH) != Stream(t + 1, data, WRENCH)
    assert Stream(t, data, WRENCH) != Stream(t, data, WRENCH, "base")
    assert Stream(t, data[:, :3].copy(), FORCE) != Stream(t, data, WRENCH)
    assert Stream(t, data, WRENCH) == Stream(t, np.asfortranarray(data), WRENCH)


def test_the_rate_is_the_mean_one_and_unknown_for_a_single_sample():
    assert stream(np.array([0, 1_000_000, 2_000_000], np.int64)).rate_hz == pytest.approx(1000.0)
    assert np.isnan(stream(np.array([5], np.int64)).rate_hz)


def test_an_event_that_ends_before_it_starts_is_refused():
    with pytest.raises(StreamError, match="stops at 1, before it starts at 2"):
        Event(2, 1, "contact")


@given(starts=st.lists(st.tuples(st.integers(0, 99), st.sampled_from(["contact", "phase"])), max_size=10))
def test_events_are_in_order_and_found_by_kind(starts):
    events = [Event(start, start + 1, kind) for start, kind in starts]
    episode = Episode("0001", "peg", {}, tuple(events[:3])).with_events(*events[3:])
    assert list(episode.events) == sorted(events)
    assert sum(len(episode.events_of(kind)) for kind in ("contact", "phase")) == len(events)


def test_an_episode_never_changes_and_gives_a_new_one():
    t = np.arange(3, dtype=np.int64)
    streams = {"wrench": stream(t)}
    episode = Episode("0001", "peg", streams, meta={"seed": 1})
    streams["pose"] = stream(t)
    assert "pose" not in episode
    with pytest.raises(TypeError):
        episode.streams["pose"] = stream(t)  # pyright: ignore[reportIndexIssue]
    with pytest.raises(AttributeError):
        episode.id = "2"  # pyright: ignore[reportAttributeAccessIssue]
    other = episode.with_stream("wrench", stream(t, seed=1)).with_meta(success=True)
    assert episode["wrench"] == stream(t)
    assert other["wrench"] == stream(t, seed=1)
    assert dict(other.meta) == {"seed": 1, "success": True}
    assert dict(episode.meta) == {"seed": 1}


def test_an_episode_travels_through_pickle():
    episode = Episode(
        "0001", "peg", {"wrench": stream(np.arange(3, dtype=np.int64))}, (Event(0, 1, "phase"),), {"a": 1}
    )
    assert pickle.loads(pickle.dumps(episode)) == episode


def test_the_span_is_that_of_all_streams():
    early, late = np.array([5, 10], np.int64), np.array([7, 2_000_000_005], np.int64)
    episode = Episode("1", "peg", {"a": stream(early), "b": stream(late), "c": stream(early[:0])})
    assert episode.span_ns == (5, 2_000_000_005)
    assert episode.duration_s == pytest.approx(2.0)
    assert Episode("1", "peg").span_ns == (0, 0)


def test_every_column_has_a_unit():
    assert (WRENCH.width, POSE.width, JOINTS.width) == (6, 7, 21)
    assert WRENCH.units == ("N", "N", "N", "N.m", "N.m", "N.m")
    with pytest.raises(StreamError, match="one unit a column"):
        Signal("odd", ("x", "y"), ("m",))
