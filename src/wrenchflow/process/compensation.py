"""From what a sensor reads to what the robot exerts: tare, weight of the payload, point, axes, filter.

`WrenchPipeline` is the one implementation. Deployment feeds it the chunks of a running robot, `process` a whole
recording; both get the same bits. For this all arithmetic is column by column: numpy never reorders an elementwise
operation, while it may reorder a matrix product with the number of rows.
"""

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.filtering import CausalFilter
from wrenchflow.force_filter import FilterConfig
from wrenchflow.process.calibration import Bias
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import segments
from wrenchflow.rig import Rig


class WrenchPipeline:
    """Streaming raw wrench -> `wrench`: about the tcp, in base axes, without bias and weight, causally filtered.

    The payload's inertia stays in: half a kilogram that a demonstration accelerates at 0.5 m/s^2 makes 0.25 N.
    """

    def __init__(self, rig: Rig, bias: Bias | Float[np.ndarray, " d"], filter: FilterConfig | None = None) -> None:
        """Prepare for one recording or one rollout.

        Args:
            rig: Sensor mount, payload and sensor rate.
            bias: Unloaded reading in the sensor frame, force [N] then moment [N.m]; three values for a force sensor.
            filter: Median and low-pass.

        Raises:
            ConfigError: If the cutoff does not fit the sensor's rate.
        """
        self._bias = bias.mean if isinstance(bias, Bias) else np.array(bias, np.float64)
        self._mount = SensorMount(rig)
        self._rate_hz = rig.sensor.rate_hz
        self._filter = CausalFilter(filter or FilterConfig(), rig.sensor.rate_hz, len(self._bias))
        self._last_ns: int | None = None

    @property
    def group_delay_s(self) -> float:
        """How far the output lags behind a slow force [s]."""
        return self._filter.group_delay_s

    def compensate(
        self, wrench_raw: Float[np.ndarray, "n d"], quat_wxyz: Float[np.ndarray, "n 4"]
    ) -> Float[np.ndarray, "n d"]:
        """Do everything but the filter, each row by itself.

        Args:
            wrench_raw: As read, in the sensor frame, force [N] then moment [N.m]. Shape (n, 3 or 6).
            quat_wxyz: Orientation of the tcp in the base at each row. Shape (n, 4).

        Returns:
            What the robot exerts on its environment, about the tcp, in base axes; a row of NaN where a reading was not
            finite. Shape (n, 3 or 6).
        """
        whole = np.isfinite(wrench_raw).all(axis=1, keepdims=True)
        wrench_raw = np.where(whole, wrench_raw, np.nan)
        R_base_sensor = self._mount.orientation(quat_wxyz)
        unloaded = wrench_raw - self._bias - self._mount.weight(R_base_sensor)[:, : len(self._bias)]
        return self._mount.to_tcp(R_base_sensor, unloaded)

    def push(
        self, t: Int64[np.ndarray, " n"], wrench_raw: Float[np.ndarray, "n d"], quat_wxyz: Float[np.ndarray, "n 4"]
    ) -> Float[np.ndarray, "n d"]:
        """Work off the next samples; where samples are missing, the filter starts anew.

        Args:
            t: Stamps [ns], after those of the last call. Shape (n,).
            wrench_raw: As read, in the sensor frame, force [N] then moment [N.m]. Shape (n, 3 or 6).
            quat_wxyz: Orientation of the tcp in the base, the last one at or before each stamp. Shape (n, 4).

        Returns:
            `wrench` at each stamp; a row of NaN where a reading was not finite: such a row is no sample. Shape (n, 3
            or 6).
        """
        rows = self.compensate(wrench_raw, quat_wxyz)
        known = t if self._last_ns is None else np.concatenate([[self._last_ns], t])
        skip = len(known) - len(t)  # The last stamp of the last call tells whether there is a gap before this one.
        for run in segments(known, self._rate_hz):
            if run.start > 0:
                self._filter.restart()
            part = slice(max(run.start - skip, 0), run.stop - skip)
            rows[part] = self._filter.push(rows[part])
        self._last_ns = int(t[-1]) if len(t) else self._last_ns
        return rows
