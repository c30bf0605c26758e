"""Statistics of what is too long to hold are those of what is held."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from wrenchflow.datasets.quantiles import quantiles_of
from wrenchflow.datasets.running import Running
from wrenchflow.datasets.summary import summarise

FRACTIONS = (0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0)
shapes = st.tuples(st.integers(1, 60), st.integers(1, 4))
floats = hnp.arrays(np.float32, shapes, elements=st.floats(-1e6, 1e6, width=32) | st.sampled_from([0.0, -0.0, 1.0]))
integers = hnp.arrays(np.int64, shapes, elements=st.integers(-(2**61), 2**61) | st.integers(-3, 3))


def parts_of(values: np.ndarray, cuts: int):
    return lambda: [part for part in np.array_split(values, cuts) if len(part)]


@given(values=floats, cuts=st.integers(1, 5))
def test_quantiles_of_floats_are_numpys_own(values, cuts):
    found = quantiles_of(parts_of(values, cuts), values.min(0), values.max(0), len(values), FRACTIONS)
    expected = np.quantile(values.astype(np.float64), FRACTIONS, axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-300)


@given(values=integers, cuts=st.integers(1, 5))
def test_ranks_of_integers_are_exact(values, cuts):
    """At a rank there is nothing to interpolate, so that the number there comes back, however large it is."""
    n = len(values)
    ranks = np.arange(n) / max(n - 1, 1)
    found = quantiles_of(parts_of(values, cuts), values.min(0), values.max(0), n, [ranks[0], ranks[-1]])
    largest = np.abs(values.astype(np.float64)).max()  # What float64 tells apart of it is all that can be asked.
    np.testing.assert_allclose(found, [values.min(0), values.max(0)], rtol=0.0, atol=4e-16 * largest)


@given(values=floats, cuts=st.integers(1, 5))
def test_running_statistics_are_those_of_all_values_at_once(values, cuts):
    blocks = parts_of(values, cuts)
    running = Running()
    for part in blocks():
        running.add(part, summarise(part))
    found, expected = running.result(blocks), summarise(values)
    assert list(found) == list(expected)
    spread = np.abs(values.astype(np.float64) - values[0]).max() + 1e-30
    for name in expected:
        assert found[name].shape == expected[name].shape, name
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-12, atol=1e-7 * spread, err_msg=name)


def test_stamps_and_truths_are_counted_too():
    stamps = 1_700_000_000_000_000_007 + np.arange(1000, dtype=np.int64) * 50_000_000
    for values in (stamps, np.arange(1000) % 7 > 2, np.arange(6000, dtype=np.float32).reshape(1000, 3, 2)):
        running = Running()
        running.add(values, summarise(values))
        found, expected = running.result(lambda values=values: [values]), summarise(values)
        for name in expected:
            np.testing.assert_allclose(
                found[name].astype(np.float64), expected[name].astype(np.float64), rtol=1e-15 if name != "std" else 1e-9
            )
