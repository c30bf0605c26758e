"""Who drives: each puts into a follower what a device says, once a period, and may look at what came of it."""

from typing import Protocol, runtime_checkable

import numpy as np

from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.devices.emulated_spacemouse import EmulatedSpaceMouse, steer_to
from wrenchflow.collect.devices.lerobot_teleoperator import SeesFollower
from wrenchflow.collect.follow import Follower
from wrenchflow.collect.operators import Operator, Perception
from wrenchflow.control.records import JOINTS
from wrenchflow.filtering import window_mean
from wrenchflow.observation import MEAN_NS
from wrenchflow.process.live import LiveWrench
from wrenchflow.sim.attempt import Attempt
from wrenchflow.sim.streams import streams_of
from wrenchflow.spatial import rotation_of


@runtime_checkable
class Driver(Protocol):
    """Decides, a period at a time."""

    full_scale_counts: int

    def decide(self, attempt: Attempt, follower: Follower, now_ns: int) -> int:
        """Let the follower move by what the device says at `now_ns`; returns the number of the phase, or -1."""
        ...

    def look_back(self, attempt: Attempt, first: int) -> None:
        """Feel the ticks from row `first` on, which have just gone by."""
        ...


class OperatorDriver:
    """An operator in Python at an emulated SpaceMouse, exact but for the whole numbers of its reports."""

    def __init__(
        self, attempt: Attempt, operator: Operator, *, period_s: float, disturbance_m: float, disturbance_s: float
    ) -> None:
        """Take an attempt at its start.

        Args:
            attempt: Tared.
            operator: Who decides.
            period_s: Between two reports.
            disturbance_m: Standard deviation of a slow disturbance of what is tracked, no part of the target.
            disturbance_s: How long it is correlated.
        """
        self._operator, self._mouse = operator, EmulatedSpaceMouse()
        self.full_scale_counts = self._mouse.full_scale_counts
        self._feel = LiveWrench(streams_of(attempt.plant.recorded), attempt.tare, attempt.rig)
        self._keep = float(np.exp(-period_s / disturbance_s))
        self._fresh_m = disturbance_m * np.sqrt(1.0 - self._keep**2)

    def decide(self, attempt: Attempt, follower: Follower, now_ns: int) -> int:
        """See, feel, decide, deflect."""
        felt, record = self._feel.tail, follower.record
        perception = Perception(
            t_s=attempt.elapsed_s,
            tcp_pose=attempt.plant.recorded[-1]["tcp_pose"],
            goal_pose=attempt.scene.T_base_goal_perceived,
            wrench=felt.data[-1],
            wrench_mean=window_mean(felt.t, felt.data, felt.t[-1:], MEAN_NS)[0],
        )
        wanted, phase = self._operator.want(perception)
        steer_to(self._mouse, record, wanted[:3], rotation_of(wanted[3:]))
        follower.take(self._mouse.read(now_ns))
        # An Ornstein-Uhlenbeck process: the demonstrations then show how to come back from where no operator would go.
        record["x_offset"] = self._keep * record["x_offset"] + self._fresh_m * attempt.rng.normal(size=3)
        follower.move(now_ns, attempt.controller)
        return attempt.task.phases.index(phase)

    def look_back(self, attempt: Attempt, first: int) -> None:
        """Feel what came of it."""
        self._feel.push(*attempt.samples_since(first))


class DeviceDriver:
    """A person at a device; what they think to be doing, nobody knows."""

    def __init__(self, device: TeleopDevice) -> None:
        """Take a device that is open."""
        self._device, self.full_scale_counts = device, device.full_scale_counts
        self._sees = device if isinstance(device, SeesFollower) else None

    def decide(self, attempt: Attempt, follower: Follower, now_ns: int) -> int:
        """Read the device.

        Raises:
            DeviceError: If it has gone.
        """
        if self._sees is not None:
            self._sees.see_follower(attempt.plant.recorded[-1]["joint_states"][:JOINTS], follower.target_pose)
        follower.take(self._device.read(now_ns))
        follower.move(now_ns, attempt.controller)
        return -1

    def look_back(self, attempt: Attempt, first: int) -> None:
        """Let the hand feel how hard the tool presses, over what would spoil the work."""
        force_n = float(np.linalg.norm(attempt.controller.ctl[0]["wrench"][:3]))
        self._device.feel(min(force_n / attempt.task.force_limit_n, 1.0))
