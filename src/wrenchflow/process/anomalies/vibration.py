"""Vibration: a tone above what the filter lets through, such as of a loose tool or a motor."""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from wrenchflow.process.anomalies.look import Look, runs_of
from wrenchflow.process.finding import Finding

KIND = "vibration"
_WINDOW = 512  # Samples of a periodogram: 2 Hz apart at 1 kHz.
_HOP = _WINDOW // 2
# Windows in a row, 1.3 s at 1 kHz: a plug that is searched with rings after each knock, and each time at another pitch.
_IN_A_ROW = 4
_FROM_HZ = 80.0  # A plug that snaps into its socket chatters at 60 to 78 Hz: contact, and no fault.
_TONE = 40.0  # Power of a line over the median line; noise alone passes it once in 10^11 lines.
# Of the sensor's scatter at least, and more than the noise that the rig grants it: a tool at rest hums a little.
_SIGMAS = 3.0


def find_vibration(look: Look) -> Iterator[Finding]:
    """Find tones: lines of the spectrum that stand out in overlapping windows, at the same frequency."""
    rate_hz = look.rig.sensor.rate_hz
    if len(look.data) < _WINDOW + (_IN_A_ROW - 1) * _HOP:
        return
    freq_hz = np.fft.rfftfreq(_WINDOW, 1.0 / rate_hz)
    band = freq_hz >= min(_FROM_HZ, 0.25 * rate_hz)
    shape = np.hanning(_WINDOW)[:, None]
    for i, name in enumerate(look.columns):
        column = sliding_window_view(look.data[:, i], _WINDOW)[::_HOP].T
        # A tone that lasts is in the scatter, too, which therefore counts up to the sensor's noise only.
        least = max(_SIGMAS * min(look.sigma[i], look.noise[i]), look.noise[i])
        power = np.abs(np.fft.rfft(shape * (column - column.mean(axis=0)), axis=0)[band]) ** 2
        floor = np.median(power, axis=0) / np.log(2.0)
        amplitude = 2.0 * np.sqrt(power) / shape.sum()
        stands = (power > _TONE * floor) & (amplitude > least) & (floor > 0.0)
        # A tone between two lines may change over from one to the other.
        near = stands.copy()
        near[1:] |= stands[:-1]
        near[:-1] |= stands[1:]
        lasts = np.logical_or.reduce(sliding_window_view(near, _IN_A_ROW, axis=1).all(axis=2))
        for first, last in runs_of(lasts):
            part = amplitude[:, first : last + _IN_A_ROW - 1].mean(axis=1)
            line, start = int(np.argmax(part)), first * _HOP
            samples = (last + _IN_A_ROW - 2) * _HOP + _WINDOW - start
            yield Finding(
                kind=KIND,
                severity="warning",
                start_ns=int(look.t[start]),
                stop_ns=look.stop_ns(start + samples - 1),
                columns=(name,),
                evidence=f"a tone of {freq_hz[band][line]:.0f} Hz and {part[line]:.2g} {look.units[i]} in {name}, for "
                f"{samples / rate_hz:.2g} s",
                samples=samples,
            )
