"""A SpaceMouse that is not there: whoever deflects it makes report bytes, and the real one's driver reads them."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.collect.devices.hid_report import WHOLE_BYTES, encode_motion
from wrenchflow.collect.devices.spacemouse import SpaceMouse
from wrenchflow.compiled import kernel
from wrenchflow.so3 import log_into, multiply_transposed_into
from wrenchflow.spacemouse_models import SpaceMouseModel

FULL_SCALE_COUNTS = 350
_MODEL = SpaceMouseModel(name="emulated SpaceMouse", full_scale_counts=FULL_SCALE_COUNTS)


class _Wire:
    """Reports that were sent and not read yet."""

    def __init__(self) -> None:
        self.reports: deque[bytes] = deque()

    def read(self, length: int, /) -> Sequence[int]:
        """The next one, or nothing."""
        return self.reports.popleft()[:length] if self.reports else b""

    def close(self) -> None:
        """There is nothing to let go of."""


class EmulatedSpaceMouse(SpaceMouse):
    """The driver of the real one, over a wire that is a queue."""

    name = "emulated"

    def __init__(self) -> None:
        """Begin at rest."""
        self._wire = _Wire()
        super().__init__(self._wire, _MODEL)

    def deflect(self, counts: Int64[np.ndarray, " 6"]) -> None:
        """Push the puck: a report of these counts goes on the wire."""
        report = np.zeros(WHOLE_BYTES, np.uint8)
        encode_motion(counts, report)
        self.send(report.tobytes())

    def send(self, report: bytes) -> None:
        """Put any bytes on the wire."""
        self._wire.reports.append(report)


@kernel
def steer(teleop, x, R, counts):
    """Axis counts that bring the target of a `TELEOP` record to a pose in a period, saturated; the map's inverse."""
    turn, out = teleop.matrices[0], teleop.vector
    multiply_transposed_into(R, teleop.R, turn)
    log_into(turn, out)
    for a in range(6):
        way = x[a] - teleop.x[a] if a < 3 else out[a - 3]
        counts[teleop.axis[a]] = count_of(teleop, teleop.sign[a] * way / (teleop.period_s * teleop.speed[a]))


@kernel
def count_of(teleop, share):
    """The count whose share of the full speed is nearest to `share`."""
    past = min(abs(share), 1.0)
    if past == 0.0:
        return np.int64(0)
    count = np.int64(np.rint((teleop.deadzone + past * (1.0 - teleop.deadzone)) * teleop.full_scale))
    return -count if share < 0.0 else count


def steer_to(
    mouse: EmulatedSpaceMouse, teleop: np.ndarray, x: Float[np.ndarray, " 3"], R: Float[np.ndarray, "3 3"]
) -> None:
    """Deflect a mouse so that the target of `teleop`, shape (1,), arrives at a pose in a period, if it can."""
    counts = np.zeros(6, np.int64)
    steer(teleop[0], x, R, counts)
    mouse.deflect(counts)
