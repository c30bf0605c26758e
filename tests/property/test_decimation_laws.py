"""Thinning a line: nothing invented, no peak lost, no gap bridged."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from wrenchflow.pages.decimation import keep_peaks

_lines = hnp.arrays(np.float64, st.integers(0, 400), elements=st.floats(-1e6, 1e6) | st.just(np.nan))
_points = st.integers(4, 100)


@given(_lines, _points)
def test_only_samples_at_their_own_times_in_order(values, points):
    t_s = 0.5 + 0.001 * np.arange(len(values))
    kept_s, kept = keep_peaks(t_s, values, points)
    assert (np.diff(kept_s) > 0).all()
    rows = np.searchsorted(t_s, kept_s)
    assert np.array_equal(t_s[rows], kept_s)
    assert np.array_equal(values[rows], kept, equal_nan=True)


@given(_lines, _points)
def test_extremes_and_ends_stay_and_the_rest_is_few(values, points):
    t_s = 0.001 * np.arange(len(values))
    kept_s, kept = keep_peaks(t_s, values, points)
    assert len(kept) <= max(points, 2) + 2
    if np.isfinite(values).any():
        assert (np.nanmin(kept), np.nanmax(kept)) == (np.nanmin(values), np.nanmax(values))
    if len(values):
        assert (kept_s[0], kept_s[-1]) == (t_s[0], t_s[-1])


@given(_lines, _points)
def test_a_line_that_is_short_enough_stays_as_it_is(values, points):
    values = values[:points]
    t_s = 0.001 * np.arange(len(values))
    kept_s, kept = keep_peaks(t_s, values, points)
    assert np.array_equal(kept_s, t_s)
    assert np.array_equal(kept, values, equal_nan=True)


@given(st.integers(20, 300), _points, st.data())
def test_a_gap_in_time_breaks_the_line_there(n, points, data):
    before = data.draw(st.integers(1, n - 1))
    t_s = 0.001 * np.arange(n)
    t_s[before:] += 0.2
    kept_s, kept = keep_peaks(t_s, np.ones(n), points)
    breaks = np.flatnonzero(np.isnan(kept))
    assert len(breaks) == 1
    assert t_s[before - 1] < kept_s[breaks[0]] < t_s[before]
    assert (np.diff(kept_s) > 0).all()


def test_what_is_not_finite_is_not_drawn():
    _, kept = keep_peaks(np.arange(3.0), np.array([1.0, np.inf, 2.0]), 10)
    assert np.array_equal(kept, [1.0, np.nan, 2.0], equal_nan=True)
