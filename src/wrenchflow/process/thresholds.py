"""From which force and which moment contact counts, derived from what the sensor shows where nothing touches."""

from dataclasses import dataclass

import numpy as np

from wrenchflow.episode import Stream
from wrenchflow.errors import ConfigError
from wrenchflow.process.calibration import Bias
from wrenchflow.process.config import ContactConfig
from wrenchflow.rig import Rig

# Contact begins this many root mean squares of the noise's norm above zero, and ends at half of that.
SIGMAS = 6.0
# What the acceleration may come to that is not taken out, and what is left of it if it is [m/s^2].
_INERTIA_LEFT_M_S2, _INERTIA_OUT_M_S2 = 0.5, 0.25
# What a bias wanders until the end of a demonstration, and what a quiet sensor's model of itself leaves out.
_DRIFT_N, _DRIFT_NM = 0.1, 0.005
# By how much the noise of a threshold that is set by hand must be cleared.
_LEAST = 3.0


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Contact begins at `on` of the force or of the moment, and ends below `off` of both.

    Attributes:
        on_n: Norm of the force [N].
        off_n: Norm of the force [N].
        on_nm: Norm of the moment [N.m]; None for a force sensor.
        off_nm: Norm of the moment [N.m]; None for a force sensor.
        noise_n: Root mean square of the force's norm in the bias window, after the filter [N].
        noise_nm: The same of the moment [N.m]; None for a force sensor.
        min_dwell_s: A shorter contact does not count, and a shorter break does not end one [s].
    """

    on_n: float
    off_n: float
    on_nm: float | None
    off_nm: float | None
    noise_n: float
    noise_nm: float | None
    min_dwell_s: float

    @classmethod
    def of(cls, labels: Stream, rig: Rig, bias: Bias, config: ContactConfig, inertia_left: str) -> "Thresholds":
        """The thresholds of one episode.

        Args:
            labels: `wrench_zero_phase`.
            rig: Payload, and the tool that makes a moment of its inertia.
            bias: Whose window shows the noise.
            config: What is set by hand.
            inertia_left: Why the payload's inertia is still in `labels`; empty if it is not.

        Raises:
            ConfigError: If a threshold that is set by hand lies within the noise.
        """
        rows = labels.between(bias.start_ns, bias.stop_ns).data
        noise_n = _rms(rows[:, :3])
        moves_n = rig.payload.mass_kg * (_INERTIA_LEFT_M_S2 if inertia_left else _INERTIA_OUT_M_S2) + _DRIFT_N
        on_n, off_n = _pair("n", noise_n, moves_n, config.on_n, config.off_n)
        noise_nm = on_nm = off_nm = None
        if labels.signal.width == 6:
            noise_nm = _rms(rows[:, 3:])
            # A force that is let pass must not count as a moment about a tcp that lies far from where it acts.
            reach_m = float(np.linalg.norm(np.subtract(rig.T_flange_tcp[:3], rig.sensor.T_flange_sensor[:3])))
            on_nm, off_nm = _pair("nm", noise_nm, moves_n * reach_m + _DRIFT_NM, config.on_nm, config.off_nm)
        return cls(
            on_n=on_n,
            off_n=off_n,
            on_nm=on_nm,
            off_nm=off_nm,
            noise_n=noise_n,
            noise_nm=noise_nm,
            min_dwell_s=config.min_dwell_s,
        )


def _rms(rows: np.ndarray) -> float:
    """Root mean square of the rows' norm about their mean."""
    return float(np.sqrt(((rows - rows.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(rows) else 0.0


def _pair(unit: str, noise: float, moves: float, on: float | None, off: float | None) -> tuple[float, float]:
    if on is None or off is None:
        on = SIGMAS * noise + moves
        return on, 0.5 * on
    if off < _LEAST * noise:
        raise ConfigError(
            f"contact.off_{unit} must stand above the noise that the bias window shows after the filter: got {off:g}, "
            f"expected {_LEAST * noise:.3g} at least ({_LEAST:g} times its root mean square)."
        )
    return on, off
