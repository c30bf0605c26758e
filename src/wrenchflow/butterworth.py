"""Butterworth low-passes as second-order sections, and the state in which they rest.

The analog prototype's poles lie evenly on a half circle; the bilinear transform, warped so that the -3 dB point stays
where it is asked for, brings them into the unit circle (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1).
`scipy.signal` has the same to the last bit, as a test holds, but takes a second to be imported, and everything that
moves an arm needs a filter: every command and every worker would pay.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from wrenchflow.errors import ConfigError

_LOWEST = 1e-4  # Of the rate: below it the poles are too near to 1 for float64.


def design(cutoff_hz: float, rate_hz: float, order: int) -> Float[np.ndarray, "s 6"]:
    """Second-order sections (b0 b1 b2 1 a1 a2) of a low-pass with its -3 dB point at `cutoff_hz`.

    Args:
        cutoff_hz: Of the filter [Hz].
        rate_hz: Of the samples [Hz].
        order: How many poles there are.

    Raises:
        ConfigError: If the cutoff is not between 0 and half the sample rate, or the order is below 1.
    """
    if not _LOWEST * rate_hz <= cutoff_hz < 0.5 * rate_hz:
        raise ConfigError(
            f"cutoff_hz is {cutoff_hz:g}, expected from {_LOWEST * rate_hz:g} to below half of the {rate_hz:g} Hz of "
            "the samples."
        )
    if order < 1:
        raise ConfigError(f"order is {order}, expected 1 or more.")
    return _designed(cutoff_hz, rate_hz, order).copy()


@lru_cache(maxsize=64)
def _designed(cutoff_hz: float, rate_hz: float, order: int) -> Float[np.ndarray, "s 6"]:
    # In the units in which the bilinear transform is s = 4 (z - 1) / (z + 1).
    angles = np.pi * np.arange(1.0 - order, 1.0, 2.0) / (2 * order)  # One of each conjugate pair, and the real pole.
    warped = 4.0 * np.tan(np.pi * (2 * cutoff_hz / rate_hz) / 2.0)
    analog = -np.exp(1j * angles) * warped
    both = np.concatenate([analog, analog[: order // 2][::-1].conj()])
    gain = warped**order * np.real(1.0 / np.prod(4.0 - both))
    poles = (4.0 + analog) / (4.0 - analog)
    # The pole that rings most comes last, when the others have taken away what would make it ring.
    poles = poles[np.argsort(np.abs(poles), kind="stable")]
    sections = np.array([(1.0, 2.0, 1.0, 1.0, -2.0 * p.real, p.real * p.real + p.imag * p.imag) for p in poles])
    if order % 2:
        sections[0, 4:] = -poles[0].real, 0.0  # The real pole is the farthest in.
        sections[-1, 1:3] = 1.0, 0.0  # One zero fewer.
    sections[0, :3] *= gain
    return sections


def steady_state(sections: Float[np.ndarray, "s 6"]) -> Float[np.ndarray, "s 2"]:
    """The state, in transposed direct form II, in which each section rests while 1 comes in forever. Shape (s, 2)."""
    state, gain = np.empty((len(sections), 2)), 1.0
    for k, section in enumerate(sections):
        b, a = section[:3], section[3:]
        left = b - b.sum() / a.sum() * a
        state[k] = gain * np.array([left[2] + left[1], left[2]])
        gain *= b.sum() / a.sum()
    return state
