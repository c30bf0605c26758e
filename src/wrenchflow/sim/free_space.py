"""Nothing but the arm and its tool in free space: the scene that a sensor is calibrated in."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.control.controller import TICK_S
from wrenchflow.rig import Payload, Pose, Rig
from wrenchflow.sim.engine import WATCH_TICKS
from wrenchflow.sim.panda import ARM_CONTYPE, WORLD_CONTYPE, make_arm
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.spatial import exp_so3, make_pose, rotation_of

TASK = "calibration"
_RADIUS_M = 0.02  # Of the rod that stands for the tool.
_NEAR_COS = math.cos(0.1)
# Where in the workspace the tool is turned about its tip: in the middle, and high enough for a tool that lies.
_HOME_SHARE = (0.5, 0.5, 0.65)


def free_space(rig: Rig, payload: Payload) -> "FreeSpace":
    """The scene with a payload in which the arm begins amid the workspace of a rig, its tool pointing down."""
    low, high = np.array(rig.workspace.min_m), np.array(rig.workspace.max_m)
    down = make_pose(low + np.array(_HOME_SHARE) * (high - low), exp_so3(np.array([math.pi, 0.0, 0.0])))
    home = pose_of(down)
    return FreeSpace(payload=payload, home=home, poses=(home,))


def pose_of(pose: Float[np.ndarray, " 7"]) -> Pose:
    """The same as plain numbers."""
    x, y, z, qw, qx, qy, qz = pose.tolist()
    return x, y, z, qw, qx, qy, qz


class RestReferee:
    """Done when the tool has been held at each of some poses, one after the other, for long enough."""

    def __init__(self, poses: Float[np.ndarray, "k 7"], rest_s: float) -> None:
        """Expect the poses in their order.

        Args:
            poses: T_base_tcp. Shape (k, 7).
            rest_s: How long the tool is to be held at each [s].
        """
        self._rotations, self._looks = rotation_of(poses[:, 3:]), round(rest_s / TICK_S / WATCH_TICKS)
        self._done = self._held = 0

    def see(self, T_base_tcp: Float[np.ndarray, "n 7"], wrench: Float[np.ndarray, "n 6"]) -> None:
        """Count how long the tool is where it is to be."""
        rotations = rotation_of(T_base_tcp[:, 3:])
        for R in rotations:
            if self._done == len(self._rotations):
                return
            # The angle between them, by the trace of their difference.
            cosine = 0.5 * (float((R * self._rotations[self._done]).sum()) - 1.0)
            self._held = self._held + 1 if cosine > _NEAR_COS else 0
            if self._held >= self._looks:
                self._done, self._held = self._done + 1, 0

    @property
    def progress(self) -> float:
        """Share of the poses."""
        return self._done / len(self._rotations)

    @property
    def failure(self) -> str:
        """Nothing but the end of the time ends it."""
        return "timeout"

    @property
    def is_lost(self) -> bool:
        """It cannot be."""
        return False


@dataclass(frozen=True, kw_only=True)
class FreeSpace:
    """The arm of a rig with a rod for a tool, amid nothing.

    Attributes:
        payload: What really hangs below the sensor, whatever the rig says.
        home: T_base_tcp where the arm begins.
        poses: T_base_tcp that the tool is to be held at, in their order.
        rest_s: For how long at each [s].
    """

    payload: Payload
    home: Pose
    poses: tuple[Pose, ...]
    rest_s: float = 1.0
    name: str = TASK
    rig: str = "panda_peg"
    phases: tuple[str, ...] = ()
    failures: tuple[str, ...] = ("timeout",)
    force_limit_n: float = 25.0
    time_limit_s: float = 600.0

    def make_spec(self, rig: Rig) -> mujoco.MjSpec:
        """The arm with the true payload below its sensor."""
        spec = make_arm(rig)
        tool, length_m = spec.body("tool"), rig.T_flange_tcp[2] - rig.sensor.T_flange_sensor[2]
        mass_kg = self.payload.mass_kg
        tool.explicitinertial = True
        tool.mass, tool.ipos = mass_kg, list(self.payload.com_sensor_m)
        # As a uniform rod: at rest none of it matters.
        across = mass_kg * (3.0 * _RADIUS_M**2 + length_m**2) / 12.0
        tool.fullinertia = [across, across, mass_kg * _RADIUS_M**2 / 2.0, 0, 0, 0]
        tool.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, 0, 0, 0, 0, max(length_m - _RADIUS_M, 1e-3)],
            size=[_RADIUS_M, 0, 0],
            rgba=[0.4, 0.42, 0.45, 1.0],
            contype=ARM_CONTYPE,
            conaffinity=WORLD_CONTYPE,
            mass=0.0,
        )
        return spec

    def draw(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scene:
        """Nothing is drawn: the arm begins at home."""
        home = np.array(self.home)
        return Scene(q_start_rad=joints_at(model, home), T_base_goal=home, T_base_goal_perceived=home)

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        """Put the arm at home."""
        mujoco.mj_resetData(model, data)
        data.qpos[:] = scene.q_start_rad
        mujoco.mj_forward(model, data)

    def contact_zone(self, scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """No place where contact is expected."""
        return np.full(3, np.inf), np.full(3, -np.inf)

    def referee(self, scene: Scene) -> RestReferee:
        """Who sees the tool held at each of the poses."""
        return RestReferee(np.array(self.poses), self.rest_s)
