"""Drives an arm that is being checked, and stops at the first sign of a contact or of a stop."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.control.config import Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.control.records import JOINTS, OBS
from wrenchflow.control.robot import Robot
from wrenchflow.control.safeguards import SAFEGUARDS
from wrenchflow.errors import StartupError

_STILL_M, _SETTLE_MAX_TICKS = 2e-4, 8000


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What some ticks saw, and what was commanded in each.

    Attributes:
        obs: Records of dtype `OBS`. Shape (n,).
        command: Torque after all limits [N.m]. Shape (n, 7).
    """

    obs: np.ndarray
    command: Float[np.ndarray, "n 7"]

    def last(self, ticks: int) -> "Seen":
        """The last ticks of them."""
        return Seen(obs=self.obs[-ticks:], command=self.command[-ticks:])


class Trial:
    """An arm under its controller, tick by tick, that must not touch anything meanwhile.

    Attributes:
        robot: The arm; a real one sets the pace.
        controller: Begun at the arm's pose.
        external_torque_nm: The largest external torque that was seen.
        contact_force_n: The largest force beyond bias and weight that was seen.
    """

    def __init__(
        self, robot: Robot, controller: Controller, impedance: Impedance, *, torque_nm: float, force_n: float
    ) -> None:
        """Take over an arm that has been read once.

        Args:
            robot: The arm.
            controller: Its controller, whose `obs` holds the arm's state.
            impedance: How stiffly it is held.
            torque_nm: More external torque on a joint than this is a contact.
            force_n: More force between tool and environment than this is a contact.
        """
        self.robot, self.controller, self.impedance = robot, controller, impedance
        self._torque_nm, self._force_n = torque_nm, force_n
        self.external_torque_nm = self.contact_force_n = 0.0
        self._look()
        controller.start(impedance)
        self.home: Float[np.ndarray, " 7"] = controller.target_pose

    def hold(self, ticks: int) -> Seen:
        """Go on with what was asked.

        Raises:
            StartupError: If the arm touches something, or control stops it.
        """
        controller, obs = self.controller, np.zeros(ticks, OBS)
        command = np.empty((ticks, JOINTS))
        for k in range(ticks):
            obs[k] = controller.obs[0]
            command[k] = controller.tick()
            self.robot.write(command[k])
            self.robot.read(controller.obs)
            self._look()
        return Seen(obs=obs, command=command)

    def settle(self, ticks: int) -> Seen:
        """Go on until the tool is still over so many ticks, and return those.

        Raises:
            StartupError: If it never is, or as `hold` does.
        """
        for _ in range(_SETTLE_MAX_TICKS // ticks):
            seen = self.hold(ticks)
            # Three parts, not two: before and after a turning point the tool is at the same place.
            places = np.array([part.mean(axis=0) for part in np.array_split(seen.obs["x"], 3)])
            moved_m = float(np.linalg.norm(np.ptp(places, axis=0)))
            if moved_m <= _STILL_M:
                return seen
        raise StartupError(
            f"the arm does not come to rest: got {moved_m:.2g} m of motion within {ticks} ticks, expected {_STILL_M:g} "
            f"m at most after {_SETTLE_MAX_TICKS} ticks."
        )

    def move(self, pose: Float[np.ndarray, " 7"], ticks: int) -> Seen:
        """Move to a pose in a straight segment."""
        self.controller.ask(self.controller.target_pose, pose, ticks=ticks, impedance=self.impedance)
        return self.hold(ticks)

    def push(self, wrench: Float[np.ndarray, " 6"], ticks: int) -> Seen:
        """Stay at home under a feed-forward wrench, base axes, about the TCP [N, N.m]."""
        self.controller.ask(self.home, self.home, ticks=1, impedance=self.impedance, wrench=wrench)
        return self.hold(ticks)

    def _look(self) -> None:
        obs, state = self.controller.obs[0], self.controller.ctl[0]
        torque_nm = np.abs(obs["tau_external"])
        joint = int(torque_nm.argmax())
        self.external_torque_nm = max(self.external_torque_nm, float(torque_nm[joint]))
        if not torque_nm[joint] <= self._torque_nm:
            raise StartupError(
                f"something touches the arm: got {torque_nm[joint]:.3g} N.m of external torque on joint {joint + 1}, "
                f"expected {self._torque_nm:g} N.m at most."
            )
        force_n = float(np.linalg.norm(state["wrench"][:3]))
        self.contact_force_n = max(self.contact_force_n, force_n)
        if not force_n <= self._force_n:
            raise StartupError(
                f"something touches the tool: the force changed by {force_n:.3g} N since the arm was at rest, "
                f"expected {self._force_n:g} N at most."
            )
        if self.controller.mode not in ("run", "hold"):
            cause = self.controller.cause
            raise StartupError(
                f"control stopped the arm during the checks: {SAFEGUARDS.get(cause, 'for no known cause')}; got mode "
                f"'{self.controller.mode}' by '{cause}', expected 'run' or 'hold'."
            )
