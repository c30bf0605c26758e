import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from wrenchflow.errors import ConfigError
from wrenchflow.filtering import CausalFilter, CausalLowpass, lowpass, window_mean, without_lag, zero_phase
from wrenchflow.force_filter import LONGEST_MEDIAN, FilterConfig
from wrenchflow.running_median import CausalMedian, centred_median

seeds = st.integers(0, 2**32 - 1)
cuts = st.lists(st.integers(0, 200), max_size=8).map(sorted)


def noise(seed: int, rows: int = 200, width: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, width))


@given(seeds, cuts, st.sampled_from([3, 6]), st.integers(1, 5))
def test_any_chunking_gives_the_bits_of_the_whole(seed: int, at: list[int], width: int, order: int):
    data = noise(seed, width=width)
    running = CausalLowpass(40.0, 1000.0, order, width)
    parts = [running.push(part) for part in np.split(data, at)]
    assert np.concatenate(parts).tobytes() == lowpass(data, 40.0, 1000.0, order).tobytes()


@given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_filtering_is_linear(seed: int, a: float, b: float):
    x, y = noise(seed), noise(seed + 1)
    for run in (lowpass, zero_phase):
        mixed = run(a * x + b * y, 40.0, 1000.0)
        np.testing.assert_allclose(mixed, a * run(x, 40.0, 1000.0) + b * run(y, 40.0, 1000.0), atol=1e-10)


@given(st.floats(-100, 100), st.floats(5, 400))
def test_a_constant_passes_unchanged_from_the_first_sample(value: float, cutoff_hz: float):
    data = np.full((300, 1), value)
    for run in (lowpass, zero_phase):
        np.testing.assert_allclose(run(data, cutoff_hz, 1000.0), data, atol=1e-9 * max(1.0, abs(value)))


@given(seeds)
def test_the_kernel_agrees_with_scipy(seed: int):
    data = noise(seed)
    sos = signal.butter(4, 40.0, fs=1000.0, output="sos")
    expected, _ = signal.sosfilt(sos, data, axis=0, zi=signal.sosfilt_zi(sos)[:, :, None] * data[0])
    np.testing.assert_allclose(lowpass(data, 40.0, 1000.0), expected, atol=1e-12)


def gain_and_lag(run, frequency_hz: float) -> tuple[float, float]:
    """Amplitude ratio and delay [s] of a long sine, by projection on sine and cosine over whole periods."""
    t = np.arange(20_000) * 1e-3
    angle = 2 * np.pi * frequency_hz * t
    middle = slice(5000, 15_000)
    out = run(np.sin(angle)[:, None], 40.0, 1000.0)[middle, 0]
    turn = 2.0 * (out @ np.exp(1j * angle[middle])) / len(out)
    response = turn.conj() * 1j
    return abs(response), -np.angle(response) / (2 * np.pi * frequency_hz)


def test_half_power_at_the_cutoff_and_half_amplitude_without_phase():
    assert gain_and_lag(lowpass, 40.0)[0] == pytest.approx(np.sqrt(0.5), abs=1e-6)
    assert gain_and_lag(zero_phase, 40.0)[0] == pytest.approx(0.5, abs=1e-6)


def test_zero_phase_has_no_lag_and_the_causal_lag_is_the_one_written_down():
    delay_s = CausalLowpass(40.0, 1000.0).group_delay_s
    assert delay_s == pytest.approx(10.3e-3, abs=0.1e-3)
    assert gain_and_lag(lowpass, 1.0)[1] == pytest.approx(delay_s, rel=2e-3)
    assert gain_and_lag(zero_phase, 10.0)[1] == pytest.approx(0.0, abs=1e-9)


@given(seeds, st.integers(0, 199), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_what_is_not_finite_stays_where_it_is(seed: int, row: int, value: float):
    data = noise(seed)
    data[row, 2] = value
    out = lowpass(data, 40.0, 1000.0)
    assert np.isnan(out[row]).all()
    assert np.isfinite(np.delete(out, row, axis=0)).all()
    assert out[:row].tobytes() == lowpass(data[:row], 40.0, 1000.0).tobytes()
    assert out[row + 1 :].tobytes() == lowpass(data[row + 1 :], 40.0, 1000.0).tobytes()


@given(seeds, st.integers(0, 150), st.integers(1, 50))
def test_a_window_mean_asked_of_a_tail_equals_that_of_everything(seed: int, query: int, length: int):
    t = np.arange(200) * 1_000_000 + 7
    data = noise(seed)
    at, window_ns = t[query : query + 1] + 300, length * 1_000_000
    first = max(query - length, 0)
    whole = window_mean(t, data, at, window_ns)
    tail = window_mean(t[first : query + 1].copy(), data[first : query + 1].copy(), at, window_ns)
    assert whole.tobytes() == tail.tobytes()
    inside = (t > at[0] - window_ns) & (t <= at[0])
    np.testing.assert_allclose(whole[0], data[inside].mean(axis=0), atol=1e-12)


def test_an_empty_window_has_no_mean_and_its_edges_are_open_then_closed():
    t, data = np.array([100, 200]), np.array([[1.0], [3.0]])
    means = window_mean(t, data, np.array([99, 100, 200, 201, 300]), 100)[:, 0]
    np.testing.assert_array_equal(means, [np.nan, 1.0, 3.0, 3.0, np.nan])


@pytest.mark.parametrize(("cutoff_hz", "order"), [(0.0, 4), (500.0, 4), (-1.0, 4), (float("nan"), 4), (40.0, 0)])
def test_an_impossible_filter_is_refused(cutoff_hz: float, order: int):
    with pytest.raises(ConfigError, match=r"cutoff_hz is|order is 0"):
        CausalLowpass(cutoff_hz, 1000.0, order)


def test_short_data_is_filtered_too():
    for rows in (0, 1, 2, 10):
        assert zero_phase(np.ones((rows, 6)), 40.0, 1000.0).shape == (rows, 6)


# ---- the median, and the two of them in a row

odd = st.integers(1, 7).map(lambda half: 2 * half + 1)


@given(seeds, cuts, st.sampled_from([3, 6]), odd, st.integers(1, 6))
def test_median_and_low_pass_in_any_chunks_give_the_bits_of_the_whole(seed, at, width, samples, order):
    config = FilterConfig(cutoff_hz=60.0, order=order, median_samples=samples)
    data = noise(seed, width=width)
    data[np.random.default_rng(seed).random(200) < 0.02] = np.nan
    whole = CausalFilter(config, 1000.0, width).push(data)
    running = CausalFilter(config, 1000.0, width)
    assert np.concatenate([running.push(part) for part in np.split(data, at)]).tobytes() == whole.tobytes()


@given(seeds, odd)
def test_the_medians_are_those_of_numpy_and_one_is_the_other_later(seed: int, samples: int):
    data, half = noise(seed, width=3), samples // 2
    windows = np.lib.stride_tricks.sliding_window_view(data, samples, axis=0)
    expected = np.median(windows, axis=-1)
    np.testing.assert_array_equal(CausalMedian(samples, 3).push(data)[samples - 1 :], expected)
    np.testing.assert_array_equal(centred_median(data, samples)[half:-half], expected)


@given(seeds, odd, st.integers(1, 7))
def test_a_spike_of_less_than_half_the_median_leaves_no_trace(seed: int, samples: int, length: int):
    spiky = np.full((200, 1), 3.0)
    at = 20 + seed % 150
    spiky[at : at + min(length, samples // 2)] = 1e4
    config = FilterConfig(median_samples=samples)
    for out in (CausalFilter(config, 1000.0, 1).push(spiky), without_lag(spiky, config, 1000.0)):
        np.testing.assert_allclose(out, 3.0, atol=1e-9)


def test_the_lag_of_a_ramp_through_both_is_the_one_written_down():
    ramp = np.arange(1000.0)[:, None]  # One unit a sample: the lag in samples is what is missing.
    for config in (FilterConfig(), FilterConfig(cutoff_hz=20.0, order=3, median_samples=9)):
        running = CausalFilter(config, 1000.0, 1)
        lag_s = (ramp[500:] - running.push(ramp)[500:]) * 1e-3
        np.testing.assert_allclose(lag_s, running.group_delay_s, rtol=1e-6)
        np.testing.assert_allclose(without_lag(ramp, config, 1000.0)[300:700], ramp[300:700], atol=1e-6)


def test_after_a_restart_nothing_is_remembered():
    config = FilterConfig(median_samples=5)
    data, running = noise(0), CausalFilter(FilterConfig(median_samples=5), 1000.0)
    running.push(noise(1))
    running.restart()
    assert running.push(data).tobytes() == CausalFilter(config, 1000.0).push(data).tobytes()


@pytest.mark.parametrize("samples", [1, 2, 4, -3, LONGEST_MEDIAN + 2])
def test_a_median_without_a_middle_is_refused(samples: int):
    with pytest.raises(ConfigError, match=r"filter\.median_samples is .* expected 0 or an odd number from 3"):
        FilterConfig(median_samples=samples)


@pytest.mark.parametrize("order", [0, 13])
def test_an_impossible_order_is_refused(order: int):
    with pytest.raises(ConfigError, match=r"filter\.order is"):
        FilterConfig(order=order)
