"""Filters that live control and offline processing share: one kernel, so that both give the same bits.

The low-pass is a Butterworth filter as second-order sections, in transposed direct form II. A sample is worked off by
itself, so the output does not depend on how the samples are cut into chunks.
"""

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.butterworth import design, steady_state
from wrenchflow.compiled import kernel
from wrenchflow.force_filter import FilterConfig
from wrenchflow.running_median import CausalMedian, centred_median

ORDER = 4


@kernel
def filter_sample(sos, state, sample, out):
    """Filter one sample of every column; `state` (s, 2, d) is kept up to date, `out` may be `sample`."""
    for column in range(sample.shape[0]):
        value = sample[column]
        for k in range(sos.shape[0]):
            result = sos[k, 0] * value + state[k, 0, column]
            state[k, 0, column] = sos[k, 1] * value - sos[k, 4] * result + state[k, 1, column]
            state[k, 1, column] = sos[k, 2] * value - sos[k, 5] * result
            value = result
        out[column] = value


@kernel
def settle(steady, state, sample):
    """Put `state` where the filter rests when `sample` has been coming in forever; `steady` (s, 2) is that for 1."""
    for k in range(steady.shape[0]):
        for column in range(sample.shape[0]):
            state[k, 0, column] = steady[k, 0] * sample[column]
            state[k, 1, column] = steady[k, 1] * sample[column]


@kernel
def _filter_rows(sos, steady, state, running, rows, out):
    for i in range(rows.shape[0]):
        finite = True
        for column in range(rows.shape[1]):
            finite = finite and np.isfinite(rows[i, column])
        if not finite:
            running = False
            out[i, :] = np.nan
            continue
        if not running:
            settle(steady, state, rows[i])
            running = True
        filter_sample(sos, state, rows[i], out[i])
    return running


class CausalLowpass:
    """A low-pass that runs along with its signal, and starts in the steady state of its first sample.

    A row that is not finite comes out as NaN and ends a run of samples; the next finite row starts a new one, so
    that no NaN spreads.
    """

    def __init__(self, cutoff_hz: float, rate_hz: float, order: int = ORDER, width: int = 6) -> None:
        """Design the filter.

        Args:
            cutoff_hz: The -3 dB point [Hz].
            rate_hz: Sample rate [Hz].
            order: Order of the filter.
            width: Number of columns.

        Raises:
            ConfigError: If there is no such filter.
        """
        self._sos = design(cutoff_hz, rate_hz, order)
        self._steady = steady_state(self._sos)
        self._state = np.zeros((len(self._sos), 2, width))
        self._running = False
        # Group delay of a section at zero frequency, in samples: sum(k b_k) / sum(b_k) - sum(k a_k) / sum(a_k).
        b, a = self._sos[:, :3], self._sos[:, 3:]
        k = np.arange(3.0)
        self._group_delay_s = float(((b @ k) / b.sum(1) - (a @ k) / a.sum(1)).sum() / rate_hz)

    @property
    def group_delay_s(self) -> float:
        """How far the output lags behind a slow input [s]."""
        return self._group_delay_s

    def push(self, rows: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Filter the next samples. Shape (n, width), in the units that came in."""
        rows = np.ascontiguousarray(rows, np.float64)
        if rows.ndim != 2 or rows.shape[1] != self._state.shape[2]:
            raise ValueError(f"expected rows of {self._state.shape[2]} columns, got an array of shape {rows.shape}.")
        out = np.empty_like(rows)
        self._running = _filter_rows(self._sos, self._steady, self._state, self._running, rows, out)
        return out

    def restart(self) -> None:
        """Forget everything: the next sample starts a new run, as after a gap."""
        self._running = False


class CausalFilter:
    """What a `FilterConfig` says, running along with its signal: the median, if there is one, then the low-pass."""

    def __init__(self, config: FilterConfig, rate_hz: float, width: int = 6) -> None:
        """Design the filter for samples at `rate_hz` [Hz] of `width` columns.

        Raises:
            ConfigError: If the cutoff does not fit the rate.
        """
        self._median = CausalMedian(config.median_samples, width) if config.median_samples else None
        self._lowpass = CausalLowpass(config.cutoff_hz, rate_hz, config.order, width)
        # The middle of the window is that old when its newest sample comes.
        median_s = (config.median_samples - 1) / (2 * rate_hz) if self._median else 0.0
        self._group_delay_s = self._lowpass.group_delay_s + median_s

    @property
    def group_delay_s(self) -> float:
        """How far the output lags behind a slow input [s]: low-pass at frequency 0, and median."""
        return self._group_delay_s

    def push(self, rows: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Filter the next samples. Shape (n, width), in the units that came in."""
        return self._lowpass.push(rows if self._median is None else self._median.push(rows))

    def restart(self) -> None:
        """Forget everything: the next sample starts a new run, as after a gap."""
        self._lowpass.restart()
        if self._median is not None:
            self._median.restart()


def without_lag(data: Float[np.ndarray, "n d"], config: FilterConfig, rate_hz: float) -> Float[np.ndarray, "n d"]:
    """Filter evenly spaced, finite samples by a centred median, if there is one, and forward and backward."""
    if config.median_samples:
        data = centred_median(data, config.median_samples)
    return zero_phase(data, config.cutoff_hz, rate_hz, config.order)


def lowpass(
    data: Float[np.ndarray, "n d"], cutoff_hz: float, rate_hz: float, order: int = ORDER
) -> Float[np.ndarray, "n d"]:
    """Filter evenly spaced samples causally: bit for bit what `CausalLowpass` gives in any chunks."""
    return CausalLowpass(cutoff_hz, rate_hz, order, data.shape[1]).push(data)


def zero_phase(
    data: Float[np.ndarray, "n d"], cutoff_hz: float, rate_hz: float, order: int = ORDER
) -> Float[np.ndarray, "n d"]:
    """Filter evenly spaced, finite samples forward and backward: no lag, twice the order, -6 dB at the cutoff.

    It looks into the future: for labels, metrics and plots, never for what a policy sees.
    """
    sections = len(design(cutoff_hz, rate_hz, order))
    if len(data) < 2:
        return data.copy()
    # Beyond its ends the signal goes on turned about them, so that the filter is under way when they come.
    padding = min(3 * (2 * sections + 1), len(data) - 1)
    before = 2.0 * data[0] - data[padding:0:-1]
    after = 2.0 * data[-1] - data[-2 : -padding - 2 : -1]
    forward = lowpass(np.concatenate([before, data, after]), cutoff_hz, rate_hz, order)
    backward = lowpass(forward[::-1], cutoff_hz, rate_hz, order)
    return np.ascontiguousarray(backward[::-1][padding:-padding])


@kernel
def _window_means(t, data, t_query, window_ns, out):
    for i in range(t_query.shape[0]):
        first = np.searchsorted(t, t_query[i] - window_ns, side="right")
        last = np.searchsorted(t, t_query[i], side="right")
        for column in range(data.shape[1]):
            total = 0.0
            for row in range(first, last):
                total += data[row, column]
            out[i, column] = total / (last - first) if last > first else np.nan


def window_mean(
    t: Int64[np.ndarray, " n"], data: Float[np.ndarray, "n d"], t_query: Int64[np.ndarray, " q"], window_ns: int
) -> Float[np.ndarray, "q d"]:
    """Mean of the samples with t_query - window_ns < t <= t_query; NaN where there is none.

    Each window is summed from its oldest to its newest sample, so that a mean asked of the last few samples of a
    running robot and one asked of a whole recording are equal, bit for bit.

    Args:
        t: Stamps [ns], increasing. Shape (n,).
        data: One row a sample. Shape (n, d).
        t_query: Where to look [ns]. Shape (q,).
        window_ns: Length of the window [ns].
    """
    out = np.empty((len(t_query), data.shape[1]))
    _window_means(np.ascontiguousarray(t), np.ascontiguousarray(data), np.ascontiguousarray(t_query), window_ns, out)
    return out
