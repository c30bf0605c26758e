"""Vibration: a tone above what the filter lets through, such as of a loose tool or a motor."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import Look, runs_of
from wrenchflow.process.finding import Finding

KIND = "vibration"
_WINDOW = 512  # Samples of a periodogram: 2 Hz apart at 1 kHz.
_FROM_HZ = 80.0  # A plug that snaps into its socket chatters at 60 to 78 Hz: contact, and no fault.
_TONE = 40.0  # Power of a line over the median line; noise alone passes it once in 10^11 lines.
# Of the sensor's scatter at least, and more than the noise that the rig grants it: a tool at rest hums a little.
_SIGMAS = 3.0


def find_vibration(look: Look) -> Iterator[Finding]:
    """Find tones: lines of the spectrum that stand out in one window after the other, at the same frequency."""
    rate_hz, count = look.rig.sensor.rate_hz, len(look.data) // _WINDOW
    if count < 2:
        return
    freq_hz = np.fft.rfftfreq(_WINDOW, 1.0 / rate_hz)
    band = freq_hz >= min(_FROM_HZ, 0.25 * rate_hz)
    shape = np.hanning(_WINDOW)[:, None]
    for i, name in enumerate(look.columns):
        column = look.data[: count * _WINDOW, i].reshape(count, _WINDOW).T
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
        lasts = (stands[:, :-1] & near[:, 1:]).any(axis=0)
        for first, last in runs_of(lasts):
            part = amplitude[:, first : last + 1].mean(axis=1)
            line = int(np.argmax(part))
            yield Finding(
                kind=KIND,
                severity="warning",
                start_ns=int(look.t[first * _WINDOW]),
                stop_ns=look.stop_ns((last + 1) * _WINDOW - 1),
                columns=(name,),
                evidence=f"a tone of {freq_hz[band][line]:.0f} Hz and {part[line]:.2g} {look.units[i]} in {name}, for "
                f"{(last + 1 - first) * _WINDOW / rate_hz:.2g} s",
                samples=(last + 1 - first) * _WINDOW,
            )
