"""The wrench of a running robot: the same tare, compensation and filter as `process`, a chunk at a time."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow import signals
from wrenchflow.episode import Event, Stream
from wrenchflow.errors import ConfigError
from wrenchflow.process.calibration import Bias, estimate_bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.stamps import held_pose
from wrenchflow.rig import Rig


class LiveWrench:
    """Filtered wrench about the TCP in base axes, as it comes, with a tail to look back on.

    Attributes:
        bias: What the tare at the start found.
    """

    def __init__(
        self,
        streams: Mapping[str, Stream],
        tare: Event,
        rig: Rig,
        config: ProcessConfig | None = None,
        *,
        tail_samples: int = 256,
    ) -> None:
        """Tare, and work off what has been recorded so far.

        Args:
            streams: `wrench_raw`, `tcp_pose` and `joint_states` from the start of the recording.
            tare: When the arm rested without contact.
            rig: Sensor, mount and payload.
            config: As `process` will use it on the recording.
            tail_samples: How many samples can be looked back on.

        Raises:
            CalibrationError: If the arm did not rest, or something touched it.
            ConfigError: If the filter is for samples on another grid than the sensor's.
        """
        config = config or ProcessConfig()
        grid_hz = config.filter.resample_hz
        if grid_hz is not None and grid_hz != rig.sensor.rate_hz:
            raise ConfigError(
                f"filter.resample_hz is {grid_hz:g}, and the samples of a running robot are not resampled: expected "
                f"the {rig.sensor.rate_hz:g} Hz of sensor '{rig.sensor.name}'."
            )
        raw, pose = streams["wrench_raw"], streams["tcp_pose"]
        self.bias: Bias = estimate_bias(
            raw,
            pose,
            streams.get("joint_states"),
            rig,
            start_ns=tare.start_ns,
            stop_ns=tare.stop_ns,
            config=config.bias,
        )
        self._pipeline = WrenchPipeline(rig, self.bias, config.filter)
        self._keep = tail_samples
        self._t = np.empty(0, np.int64)
        self._rows = np.empty((0, raw.signal.width))
        before, held = held_pose(pose, raw.t)
        self.push(raw.t[before:], raw.data[before:], held[:, 3:])

    def push(
        self, t: Int64[np.ndarray, " n"], wrench_raw: Float[np.ndarray, "n d"], quat_wxyz: Float[np.ndarray, "n 4"]
    ) -> None:
        """Work off new samples; arguments as for `WrenchPipeline.push`."""
        rows = self._pipeline.push(t, wrench_raw, quat_wxyz)
        known = np.isfinite(rows).all(axis=1)  # A reading that was not finite is no sample, here as in `process`.
        t, rows = t[known], rows[known]
        self._t = np.concatenate([self._t, t])[-self._keep :]
        self._rows = np.concatenate([self._rows, rows])[-self._keep :]

    @property
    def tail(self) -> Stream:
        """The last filtered samples."""
        return Stream(self._t, self._rows, signals.WRENCH, "base")
