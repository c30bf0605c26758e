"""Connector insertion: a rectangular plug that has to be turned to fit, and to be snapped in with at most 30 N."""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.rig import Rig
from wrenchflow.sim.panda import make_arm
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks.connector_parts import ConnectorShape
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.spatial import compose, exp_so3, inverse, make_pose, rotation_of

# The goal's frame lies on the socket's mouth with z into it, as the tool's does: a half turn about x.
_INTO_SOCKET = exp_so3(np.array([math.pi, 0.0, 0.0]))
_ZONE_M = 0.06  # Half width of what surely holds the fixture, wherever it seems to be.
_WATCH_S = 0.005  # Time between two looks of a referee.


@dataclass(frozen=True, kw_only=True)
class ConnectorInsertion:
    """A plug, a socket somewhere near and turned, and a guess of both that is off.

    Geometry: the plug is 14 x 6 mm, a shell whose rim is a ring of 12 capsules; the socket has 0.25 mm of play a side,
    chamfers of 0.5 mm at 45 degrees, and a flat around its mouth. The plug falls in by itself within 1.05 mm of the
    middle along x and along y; in the socket it can turn by 2 degrees, in the chamfers by 8.

    Latch: two noses overlap two springs by 0.4 mm where the tip is 6 mm deep. They are soft contacts and no bodies, so
    the arm's seven joints are the model's only ones. The crest takes 13 N and 10 mJ: 13 N of who pushes slowly, 13.4 N
    at 30 mm/s, 14 N of an arm that coasts in, which by momentum alone takes 60 mm/s. Then the force falls to 5 N, and
    rubber from 6.1 mm on stops the plug at 7 mm. Who eases off as soon as the latch gives feels 17 to 20 N there,
    by hand on a soft arm up to 22 N; the leash alone would allow 25 N.

    Contact: steel has friction 0.2, solref 4 ms, and a stiffness that comes in from zero over 0.1 mm; latch and rubber
    have contacts of their own, by priority.

    Randomisation: the socket within 25 mm and 20 degrees, perceived with a standard deviation of 1.5 mm in x and in y
    and of 3 degrees; the start within 20 mm of what is perceived, 30 to 45 mm above it, tilted by up to a degree and
    turned by up to 8.

    Force is needed to find the socket, to turn the plug, and to get over the crest without ever exceeding 30 N. The
    scripted operator seats 99 % of its plugs; with its wrench zeroed none, for it neither finds the mouth nor pushes.
    Who feels nothing and presses 6 N where the socket seems to be, then 18 N, seats 16 %. The blind spiral, which
    remembers where it has been, gets most plugs in and none over the crest, for it leans on them with 5 N; with 18 N it
    would seat 78 %, and exceeds 30 N in 2 %.
    """

    name: str = "connector-insertion"
    rig: str = "panda_plug"
    phases: tuple[str, ...] = ("approach", "land", "search", "insert", "snap")
    failures: tuple[str, ...] = ("over-force", "unseated", "jammed", "missed", "timeout")
    time_limit_s: float = 12.0
    shape: ConnectorShape = field(default_factory=ConnectorShape)
    force_limit_n: float = 30.0  # low-passed at 50 Hz
    seated_m: float = 0.0064  # depth of the tip that is past the crest
    settle_s: float = 0.1  # for which it has to stay there
    centre_m: tuple[float, float, float] = (0.50, 0.0, 0.10)  # middle of where the mouth may be
    position_range_m: float = 0.025
    yaw_range_rad: float = math.radians(20.0)
    perception_sigma_m: float = 0.0015
    perception_sigma_rad: float = math.radians(3.0)
    start_height_m: tuple[float, float] = (0.030, 0.045)
    start_range_m: float = 0.020
    start_tilt_rad: float = math.radians(1.0)
    start_yaw_rad: float = math.radians(8.0)

    def make_spec(self, rig: Rig) -> mujoco.MjSpec:
        """The arm with the plug below its sensor, and the fixture with the socket as a body that can be moved."""
        spec = make_arm(rig)
        tool, flange = spec.body("tool"), spec.body("flange")
        sensor_z, mass_kg = rig.sensor.T_flange_sensor[2], rig.payload.mass_kg
        tip_m = rig.T_flange_tcp[2] - sensor_z
        tool.explicitinertial = True
        tool.mass, tool.ipos = mass_kg, list(rig.payload.com_sensor_m)
        # As a uniform rod of 20 mm radius: its own small inertia hardly matters beside the arm's.
        across = mass_kg * (3.0 * 0.02**2 + tip_m**2) / 12.0
        tool.fullinertia = [across, across, mass_kg * 0.02**2 / 2.0, 0, 0, 0]
        looks = {"contype": 0, "conaffinity": 0, "mass": 0.0, "type": mujoco.mjtGeom.mjGEOM_CYLINDER}
        flange.add_geom(fromto=[0, 0, 0, 0, 0, sensor_z], size=[0.035, 0, 0], rgba=[0.2, 0.2, 0.22, 1], **looks)
        tool.add_geom(fromto=[0, 0, 0, 0, 0, 0.03], size=[0.028, 0, 0], rgba=[0.4, 0.42, 0.45, 1], **looks)
        tool.add_geom(fromto=[0, 0, 0.03, 0, 0, tip_m - 0.03], size=[0.012, 0, 0], rgba=[0.4, 0.42, 0.45, 1], **looks)
        T_sensor_tcp = compose(inverse(np.array(rig.sensor.T_flange_sensor)), np.array(rig.T_flange_tcp))
        self.shape.add_plug(tool.add_body(name="plug", pos=T_sensor_tcp[:3], quat=T_sensor_tcp[3:], gravcomp=1.0))
        block = spec.worldbody.add_body(name="block", mocap=True, pos=list(self.centre_m))
        block.add_site(name="goal", quat=[0.0, 1.0, 0.0, 0.0], size=[0.001, 0.001, 0.001])
        self.shape.add_socket(block, self.centre_m[2])
        return spec

    def draw(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scene:
        """Draw where the socket is, where it seems to be, and where the plug starts."""
        offset_m = np.array([*rng.uniform(-1, 1, 2) * self.position_range_m, 0.0])
        yaw_rad = rng.uniform(-1, 1) * self.yaw_range_rad
        goal = make_pose(np.array(self.centre_m) + offset_m, _about_z(yaw_rad) @ _INTO_SOCKET)
        wrong_m = np.array([*rng.normal(size=2) * self.perception_sigma_m, 0.0])
        seen_rad = yaw_rad + rng.normal() * self.perception_sigma_rad
        perceived = make_pose(goal[:3] + wrong_m, _about_z(seen_rad) @ _INTO_SOCKET)
        height_m = rng.uniform(*self.start_height_m)
        start_m = perceived[:3] + np.array([*rng.uniform(-1, 1, 2) * self.start_range_m, height_m])
        direction, tilt_rad = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, self.start_tilt_rad)
        tilt = exp_so3(tilt_rad * np.array([math.cos(direction), math.sin(direction), 0.0]))
        turned = _about_z(seen_rad + rng.uniform(-1, 1) * self.start_yaw_rad)
        start = make_pose(start_m, tilt @ turned @ _INTO_SOCKET)
        return Scene(q_start_rad=joints_at(model, start), T_base_goal=goal, T_base_goal_perceived=perceived)

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        """Put the fixture where the scene has its socket, and the arm at its start."""
        mujoco.mj_resetData(model, data)
        data.qpos[:] = scene.q_start_rad
        block = compose(scene.T_base_goal, make_pose(np.zeros(3), _INTO_SOCKET.T))
        data.mocap_pos[0], data.mocap_quat[0] = block[:3], block[3:]
        mujoco.mj_forward(model, data)

    def contact_zone(self, scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """The fixture around the perceived goal, and a little above it."""
        goal_m = scene.T_base_goal_perceived[:3]
        return goal_m - np.array([_ZONE_M, _ZONE_M, 0.02]), goal_m + np.array([_ZONE_M, _ZONE_M, 0.01])

    def referee(self, scene: Scene) -> "ConnectorReferee":
        """Who judges one attempt by depth and by force."""
        return ConnectorReferee(self, scene)


def _about_z(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    return exp_so3(np.array([0.0, 0.0, angle_rad]))


class ConnectorReferee:
    """Seated is what stays past the crest for a while, so that the blow on the stop counts; who crushes has lost."""

    def __init__(self, task: ConnectorInsertion, scene: Scene) -> None:
        """Judge one attempt at a scene."""
        self._task, self._goal_m, self._R_base_goal = task, scene.T_base_goal[:3], rotation_of(scene.T_base_goal[3:])
        self._tip_m = np.array([0.0, 0.0, -np.inf])
        self._settled = 0
        self.is_lost = False  # Once the force was too high, for ever.

    def see(self, T_base_tcp: Float[np.ndarray, "n 7"], wrench: Float[np.ndarray, "n 6"]) -> None:
        """Take in what has happened: the largest force, and for how long the tip has been deep enough."""
        if not len(T_base_tcp):
            return
        self.is_lost = self.is_lost or bool(np.linalg.norm(wrench[:, :3], axis=1).max() > self._task.force_limit_n)
        tips_m = (T_base_tcp[:, :3] - self._goal_m) @ self._R_base_goal
        self._tip_m = tips_m[-1]
        loose = np.flatnonzero(self._depth_shares(tips_m) < 1.0)
        self._settled = len(tips_m) - 1 - int(loose[-1]) if len(loose) else self._settled + len(tips_m)

    def _depth_shares(self, tips_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Depth of the tip in the socket over the depth that counts as seated, from 0 to 1."""
        is_in = np.hypot(tips_m[:, 0], tips_m[:, 1]) <= 4.0 * self._task.shape.clearance_m
        return np.where(is_in, np.clip(tips_m[:, 2] / self._task.seated_m, 0.0, 1.0), 0.0)

    @property
    def _depth_share(self) -> float:
        return float(self._depth_shares(self._tip_m[None])[0])

    @property
    def progress(self) -> float:
        """Nine tenths by depth, the last by how long it has been there; nobody gets that who crushed the connector."""
        if self.is_lost:
            return 0.9 * self._depth_share
        return 0.9 * self._depth_share + 0.1 * min(self._settled * _WATCH_S / self._task.settle_s, 1.0)

    @property
    def failure(self) -> str:
        """`over-force`; `unseated` in the socket, `jammed` in its mouth, `missed` on the flat, else `timeout`."""
        if self.is_lost:
            return "over-force"
        depth_m = self._depth_share * self._task.seated_m
        if depth_m > 2.0 * self._task.shape.chamfer_m:
            return "unseated"
        if depth_m > 0.2 * self._task.shape.chamfer_m:
            return "jammed"
        return "missed" if self._tip_m[2] > -0.001 else "timeout"
