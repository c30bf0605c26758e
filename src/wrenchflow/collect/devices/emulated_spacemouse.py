"""A SpaceMouse that is not there: whoever deflects it makes report bytes, and the real one's decoder reads them."""

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.devices.hid_report import SOUND, WHOLE_BYTES, decode, encode_motion
from wrenchflow.compiled import kernel
from wrenchflow.so3 import log_into, multiply_transposed_into

FULL_SCALE_COUNTS = 350


class EmulatedSpaceMouse:
    """Its wire holds what was sent and not yet read; as a `TeleopDevice` it reads the newest of it."""

    name, full_scale_counts = "emulated", FULL_SCALE_COUNTS

    def __init__(self) -> None:
        """Begin at rest."""
        self._wire: list[np.ndarray] = []
        self._counts, self._buttons, self._t_ns = np.zeros(6, np.int64), np.zeros(1, np.int64), 0
        self._problem = ""

    def deflect(self, counts: Int64[np.ndarray, " 6"]) -> None:
        """Push the puck: a report of these counts goes on the wire."""
        report = np.zeros(WHOLE_BYTES, np.uint8)
        encode_motion(counts, report)
        self.send(report)

    def send(self, report: np.ndarray) -> None:
        """Put any bytes on the wire."""
        self._wire.append(report)

    def read(self, now_ns: int) -> Reading:
        """The newest of what is on the wire."""
        for report in self._wire:
            code = decode(report, len(report), self._counts, self._buttons)
            self._problem = "" if code <= SOUND + 1 else f"a report of {len(report)} bytes that makes no sense"
            self._t_ns = now_ns if code == SOUND else self._t_ns
        self._wire.clear()
        return Reading(
            t_ns=self._t_ns, counts=self._counts.copy(), buttons=int(self._buttons[0]), problem=self._problem
        )

    def feel(self, share: float) -> None:
        """Nobody holds it."""

    def close(self) -> None:
        """There is nothing to let go of."""


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
