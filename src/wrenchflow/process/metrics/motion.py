"""How smoothly, how far and how steadily the tcp moves.

SPARC: Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, 2015, "On the analysis of movement smoothness".
LDLJ: the log dimensionless jerk of the same paper, of the velocity.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Episode, Stream
from wrenchflow.filtering import window_mean, zero_phase
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metrics.figure import Figure, unknown_all

MOTION = ("sparc", "ldlj", "path_length_m", "idle_fraction")
_RATE_HZ = 100.0
_BAND_HZ = 10.0  # Arms and people are slower.
_AMPLITUDE = 0.05
_PAD = 4  # Powers of two by which the spectrum is refined.
_IDLE_M_S = 0.002
_MIN_S = 0.5
_LONGEST_STEP_S = 0.1  # Over a longer one nobody knows how the tcp moved.


def velocity(episode: Episode) -> tuple[np.ndarray, Float[np.ndarray, "n 3"]] | str:
    """Velocity of the tcp at 100 Hz, low-passed at 10 Hz, or why it cannot be told.

    Returns:
        Stamps [ns] and velocities [m/s].
    """
    source: Stream | None = next(
        (episode.streams[name] for name in ("tcp_pose", "tcp_twist") if len(episode.streams.get(name, ()))), None
    )
    if source is None:
        return "there is neither a stream 'tcp_pose' nor 'tcp_twist'"
    data = source.data[:, :3]
    good = np.isfinite(data).all(axis=1)
    t, data = source.t[good], data[good]
    if len(t) < 2 or (t[-1] - t[0]) * 1e-9 < _MIN_S:
        return f"the tcp is known for less than {_MIN_S:g} s"
    longest_s = float(np.diff(t).max()) * 1e-9
    if longest_s > _LONGEST_STEP_S:
        return f"the tcp is unknown for {longest_s:.3g} s, {_LONGEST_STEP_S:g} s allowed"
    period_ns = round(1e9 / _RATE_HZ)
    grid = np.arange(t[0] + period_ns, t[-1] + 1, period_ns)
    if source.rate_hz > 2.0 * _RATE_HZ:
        rows = window_mean(t, data, grid, period_ns)
    else:
        rows = np.stack([np.interp(grid, t, column) for column in data.T], axis=1)
    hole = ~np.isfinite(rows[:, 0])
    if hole.any():
        known = np.flatnonzero(~hole)
        rows = np.stack([np.interp(np.arange(len(rows)), known, column[known]) for column in rows.T], axis=1)
    if source.signal.kind in ("pose", "position"):
        rows = np.gradient(rows, 1.0 / _RATE_HZ, axis=0) if len(rows) > 1 else np.zeros_like(rows)
    return grid, zero_phase(rows, _BAND_HZ, _RATE_HZ)


def motion_figures(moved: tuple[np.ndarray, Float[np.ndarray, "n 3"]] | str) -> Iterator[Figure]:
    """Smoothness, length of the path, and rest.

    Args:
        moved: What `velocity` returns, or a part of it.
    """
    if isinstance(moved, str):
        yield from unknown_all(MOTION, moved)
        return
    _, rows = moved
    speed = np.linalg.norm(rows, axis=1)
    if len(speed) < _MIN_S * _RATE_HZ:
        yield from unknown_all(MOTION, f"the tcp is known for less than {_MIN_S:g} s")
        return
    yield "path_length_m", float(speed.sum() / _RATE_HZ)
    yield "idle_fraction", float((speed < _IDLE_M_S).mean())
    if speed.max() < _IDLE_M_S:
        for name in ("sparc", "ldlj"):
            yield NotAssessed(kind=name, reason=f"the tcp never moves faster than {1e3 * _IDLE_M_S:g} mm/s")
        return
    yield "sparc", sparc(speed, _RATE_HZ)
    yield "ldlj", ldlj(rows, _RATE_HZ)


def sparc(speed: Float[np.ndarray, " n"], rate_hz: float) -> float:
    """Spectral arc length of a speed profile: 0 has none, each further submovement makes it more negative."""
    count = 2 ** (int(np.ceil(np.log2(len(speed)))) + _PAD)
    spectrum = np.abs(np.fft.rfft(speed, count))
    spectrum /= spectrum.max()
    hz = np.fft.rfftfreq(count, 1.0 / rate_hz)
    inside = hz <= _BAND_HZ
    hz, spectrum = hz[inside], spectrum[inside]
    # Up to the last frequency that still has something to say.
    last = int(np.flatnonzero(spectrum >= _AMPLITUDE)[-1])
    hz, spectrum = hz[: last + 1], spectrum[: last + 1]
    if last == 0:
        return 0.0
    return -float(np.hypot(np.diff(hz) / hz[-1], np.diff(spectrum)).sum())


def ldlj(velocities: Float[np.ndarray, "n 3"], rate_hz: float) -> float:
    """Log dimensionless jerk of a motion."""
    jerk = np.gradient(np.gradient(velocities, 1.0 / rate_hz, axis=0), 1.0 / rate_hz, axis=0)
    duration_s = len(velocities) / rate_hz
    peak = float(np.linalg.norm(velocities, axis=1).max())
    total = float((jerk**2).sum()) / rate_hz * duration_s**3 / peak**2
    return -float(np.log(total)) if total > 0.0 else 0.0
