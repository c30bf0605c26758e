"""An operator's hand on a SpaceMouse: what is wanted becomes whole axis counts, as the device would report them."""

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.collect.devices.twist_map import TwistMap
from wrenchflow.spatial import log_so3, rotation_of


class EmulatedSpaceMouse:
    """Deflected each period so that the target would arrive where the operator wants it, saturated and quantised."""

    def __init__(self, twist_map: TwistMap, period_s: float) -> None:
        """Take the map that the reports will be read with, and the time between reports."""
        self._map = twist_map
        self._period_s = period_s
        self._counts = np.zeros(6, np.int64)

    def deflect(self, wanted: Float[np.ndarray, " 7"], target: Float[np.ndarray, " 7"]) -> None:
        """Push the puck towards a wanted target pose, given the present one."""
        turn_rad = log_so3(rotation_of(wanted[3:]) @ rotation_of(target[3:]).T)
        self._counts = self._map.counts(np.concatenate([wanted[:3] - target[:3], turn_rad]) / self._period_s)

    def read(self) -> tuple[Int64[np.ndarray, " 6"], Int64[np.ndarray, " 2"]]:
        """The newest report: axis counts and buttons."""
        return self._counts, np.zeros(2, np.int64)
