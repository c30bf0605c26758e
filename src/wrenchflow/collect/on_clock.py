"""A device on the clock of one attempt: virtual time begins anew with each, and a device goes on."""

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.devices.device import Reading, TeleopDevice
from wrenchflow.collect.devices.lerobot_teleoperator import SeesFollower


class OnClock:
    """A `TeleopDevice` that is told a time which never goes back, and whose stamps are of the attempt's clock.

    What a device said in the last attempt is old then, as it should be: a key that was held counts as let go of.
    """

    def __init__(self, device: TeleopDevice, offset_ns: int) -> None:
        """Take a device.

        Args:
            device: That is open.
            offset_ns: What the device's clock shows more than the attempt's [ns].
        """
        self._device, self._offset_ns = device, offset_ns
        self.name, self.full_scale_counts = device.name, device.full_scale_counts
        self._follower = device if isinstance(device, SeesFollower) else None

    def read(self, now_ns: int) -> Reading:
        """What the device says."""
        said = self._device.read(now_ns + self._offset_ns)
        t_ns = said.t_ns - self._offset_ns
        return Reading(t_ns=t_ns, counts=said.counts, buttons=said.buttons, pose=said.pose, problem=said.problem)

    def see_follower(self, q_rad: Float[np.ndarray, " n"], pose: Float[np.ndarray, " 7"]) -> None:
        """Tell a device that has to know where the arm is."""
        if self._follower is not None:
            self._follower.see_follower(q_rad, pose)

    def feel(self, share: float) -> None:
        """As the device does."""
        self._device.feel(share)

    def close(self) -> None:
        """Nothing: the device goes on to the next attempt."""
