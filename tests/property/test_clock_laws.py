"""One clock that never steps, and the offset of another one, told from messages that are late but never early."""

import time

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.clock import SECOND_NS, Clock, ClockOffset


def test_a_clock_goes_on_from_the_epochs_time_as_the_monotonic_one_does(monkeypatch):
    clock = Clock.start()
    assert abs(clock.now_ns() - time.time_ns()) < SECOND_NS
    monkeypatch.setattr(time, "time_ns", lambda: 0)  # Somebody sets the date.
    before = time.monotonic_ns()
    assert clock.at_ns(before) <= clock.now_ns() <= clock.at_ns(time.monotonic_ns())


DELAYS = st.lists(st.integers(0, 5_000_000), min_size=1, max_size=200)


@given(st.integers(-(10**18), 10**18), DELAYS)
def test_the_offset_is_off_by_the_shortest_delay(offset: int, delays: list[int]):
    told = ClockOffset()
    for number, delay in enumerate(delays):
        device_ns = number * 1_000_000
        shown = told.see(device_ns, device_ns + offset + delay)
        assert shown == offset + min(delays[: number + 1])
        assert device_ns + shown <= device_ns + offset + delay  # Nothing is sampled after it was received.


@given(st.integers(-100, 100), st.integers(0, 2**32))
def test_the_offset_follows_a_clock_that_runs_fast_or_slow(drift_ppm: int, seed: int):
    """Over a window the clocks drift apart by `drift * window`: that, and the delay, bounds the error."""
    told, rng = ClockOffset(window_ns=SECOND_NS), np.random.default_rng(seed)
    for t in range(0, 20 * SECOND_NS, SECOND_NS // 100):
        device_ns = t + round(t * drift_ppm * 1e-6)
        shown = told.see(device_ns, t + int(rng.integers(0, 2_000_000)))
        assert abs(shown - (t - device_ns)) <= 2_000_000 + 2 * abs(drift_ppm) * 1e-6 * SECOND_NS + 1
