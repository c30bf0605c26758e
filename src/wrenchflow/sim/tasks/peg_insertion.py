"""Peg insertion: a round peg of 20 mm, a hole with 0.5 mm of play on the diameter, and a perception that is off."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.rig import Rig
from wrenchflow.sim.panda import ARM_CONTYPE, WORLD_CONTYPE, make_arm
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.spatial import compose, exp_so3, make_pose, quat_of, rotation_of

_FACETS = 24
# The goal's frame lies on the hole's mouth with z into the hole, as the tool's does: a half turn about x.
_INTO_HOLE = exp_so3(np.array([math.pi, 0.0, 0.0]))
_ZONE_M = 0.07  # The block's half width, what perception may be off, and what the tool may be tilted.
_STEEL, _FIXTURE, _MOUTH = (0.66, 0.68, 0.72, 1.0), (0.32, 0.46, 0.62, 1.0), (0.95, 0.7, 0.25, 1.0)


@dataclass(frozen=True, kw_only=True)
class PegInsertion:
    """A round peg, a chamfered hole somewhere near, and a guess of where it is.

    The peg is a ring of capsules, because a cylinder against boxes chatters; the hole is 24 tangent boxes a ring: wall,
    45 degree chamfer and collar. The peg falls in by itself only within `capture_radius_m` of the hole's axis.
    """

    name: str = "peg-insertion"
    rig: str = "panda_peg"
    phases: tuple[str, ...] = ("approach", "land", "search", "insert")
    failures: tuple[str, ...] = ("jammed", "missed", "timeout")
    time_limit_s: float = 8.0
    force_limit_n: float = 25.0
    peg_radius_m: float = 0.010
    clearance_m: float = 0.00025  # on the radius
    chamfer_m: float = 0.0003
    rim_radius_m: float = 0.0003  # of the capsules that the peg's rim is made of
    hole_depth_m: float = 0.030
    success_depth_m: float = 0.020
    centre_m: tuple[float, float, float] = (0.50, 0.0, 0.12)  # middle of where the mouth may be
    position_range_m: float = 0.025
    yaw_range_rad: float = math.radians(15.0)
    perception_sigma_m: float = 0.002
    start_height_m: tuple[float, float] = (0.035, 0.055)
    start_range_m: float = 0.020
    start_tilt_rad: float = math.radians(1.0)
    friction: float = 0.2

    @property
    def capture_radius_m(self) -> float:
        """How far off the axis the rim still meets the chamfer."""
        return self.clearance_m + self.chamfer_m + self.rim_radius_m

    def make_spec(self, rig: Rig) -> mujoco.MjSpec:
        """The arm with the peg below its sensor, and the block with the hole as a body that can be moved."""
        spec = make_arm(rig)
        self._add_peg(spec, rig)
        self._add_block(spec)
        return spec

    def _contact(self) -> dict:
        # Stiff, for at MuJoCo's defaults a 20 N push sinks in by more than the clearance; but with a force that grows
        # from nothing over the first 0.1 mm, as that of a fixture and a sensor does. With MuJoCo's usual jump at the
        # surface, a peg that slides at 10 mm/s has no contact at all in 45 % of the ticks. 8 N sink in by 32 um.
        return {
            "friction": [self.friction, 0.0, 0.0],
            "solref": [0.004, 1.0],
            "solimp": [0.0, 0.95, 0.0001, 0.5, 2.0],
            "condim": 3,
        }

    def _add_peg(self, spec: mujoco.MjSpec, rig: Rig) -> None:
        tool, flange = spec.body("tool"), spec.body("flange")
        mass_kg, com_m = rig.payload.mass_kg, rig.payload.com_sensor_m
        length_m = rig.T_flange_tcp[2] - rig.sensor.T_flange_sensor[2]
        tool.explicitinertial = True
        tool.mass, tool.ipos = mass_kg, list(com_m)
        # As a uniform rod of the peg's radius: its own small inertia hardly matters beside the arm's.
        across = mass_kg * (3.0 * self.peg_radius_m**2 + length_m**2) / 12.0
        tool.fullinertia = [across, across, mass_kg * self.peg_radius_m**2 / 2.0, 0, 0, 0]
        looks = {"contype": 0, "conaffinity": 0, "mass": 0.0, "type": mujoco.mjtGeom.mjGEOM_CYLINDER}
        sensor_z = rig.sensor.T_flange_sensor[2]
        flange.add_geom(fromto=[0, 0, 0, 0, 0, sensor_z], size=[0.035, 0, 0], rgba=[0.2, 0.2, 0.22, 1], **looks)
        tool.add_geom(fromto=[0, 0, 0, 0, 0, 0.04], size=[0.028, 0, 0], rgba=[0.4, 0.42, 0.45, 1], **looks)
        tool.add_geom(fromto=[0, 0, 0.04, 0, 0, length_m], size=[self.peg_radius_m, 0, 0], rgba=_STEEL, **looks)
        ring_m = self.peg_radius_m - self.rim_radius_m
        for i in range(_FACETS):
            angle = 2.0 * math.pi * (i + 0.5) / _FACETS
            x, y = ring_m * math.cos(angle), ring_m * math.sin(angle)
            tool.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[x, y, length_m - 0.05, x, y, length_m - self.rim_radius_m],
                size=[self.rim_radius_m, 0, 0],
                rgba=_STEEL,
                contype=ARM_CONTYPE,
                conaffinity=WORLD_CONTYPE,
                mass=0.0,
                **self._contact(),
            )

    def _add_block(self, spec: mujoco.MjSpec) -> None:
        block = spec.worldbody.add_body(name="block", mocap=True, pos=list(self.centre_m))
        block.add_site(name="goal", quat=list(quat_of(_INTO_HOLE)), size=[0.001, 0.001, 0.001])
        hole_m = self.peg_radius_m + self.clearance_m
        mouth_m = hole_m + self.chamfer_m
        half_turn = math.pi / _FACETS
        for i in range(_FACETS):
            angle = 2.0 * math.pi * i / _FACETS

            def add(
                near_m: float, far_m: float, top_m: float, bottom_m: float, rgba: tuple, angle: float = angle
            ) -> None:
                # A box whose inner face is tangent at `near_m`: tangent boxes never reach into the polygon of the hole.
                middle_m = (near_m + far_m) / 2.0
                block.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    pos=[middle_m * math.cos(angle), middle_m * math.sin(angle), (top_m + bottom_m) / 2.0],
                    quat=[math.cos(angle / 2), 0, 0, math.sin(angle / 2)],
                    size=[(far_m - near_m) / 2.0, far_m * math.tan(half_turn) * 1.02, (top_m - bottom_m) / 2.0],
                    rgba=rgba,
                    contype=WORLD_CONTYPE,
                    conaffinity=ARM_CONTYPE,
                    **self._contact(),
                )

            add(hole_m, hole_m + 0.012, -self.chamfer_m, -self.hole_depth_m, _FIXTURE)
            add(mouth_m, 0.022, 0.0, -0.008, _MOUTH)
            add(0.022, 0.055, 0.0, -0.008, _FIXTURE)
            # The chamfer: the upper face of a box tilted by 45 degrees, from the wall's top edge to the mouth's.
            half_m = self.chamfer_m / math.sqrt(2.0)
            thick_m = 0.002
            centre_m = (hole_m + mouth_m) / 2.0
            tilt = math.pi / 4.0
            outward, down = math.sin(tilt) * thick_m, math.cos(tilt) * thick_m
            radius_m, z_m = centre_m + outward, -self.chamfer_m / 2.0 - down
            axis = np.array([math.cos(angle), math.sin(angle), 0.0])
            across = np.array([-math.sin(angle), math.cos(angle), 0.0])
            slope = (axis + np.array([0.0, 0.0, 1.0])) / math.sqrt(2.0)
            rotation = np.stack([slope, across, np.cross(slope, across)], axis=-1)
            block.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[*(radius_m * axis[:2]), z_m],
                quat=list(quat_of(rotation)),
                size=[half_m, mouth_m * math.tan(half_turn) * 1.02, thick_m],
                rgba=_MOUTH,
                contype=WORLD_CONTYPE,
                conaffinity=ARM_CONTYPE,
                **self._contact(),
            )
        base_m = self.centre_m[2] - self.hole_depth_m
        block.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[0, 0, -self.hole_depth_m - base_m / 2.0],
            size=[0.055, 0.055, base_m / 2.0],
            rgba=_FIXTURE,
            contype=WORLD_CONTYPE,
            conaffinity=ARM_CONTYPE,
            **self._contact(),
        )

    def draw(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scene:
        """Draw where the hole is, where it seems to be, and where the peg starts."""
        offset_m = np.array([*rng.uniform(-1, 1, 2) * self.position_range_m, 0.0])
        yaw = exp_so3(np.array([0.0, 0.0, rng.uniform(-1, 1) * self.yaw_range_rad]))
        goal = make_pose(np.array(self.centre_m) + offset_m, yaw @ _INTO_HOLE)
        wrong_m = np.array([*rng.normal(size=2) * self.perception_sigma_m, 0.0])
        perceived = np.concatenate([goal[:3] + wrong_m, goal[3:]])
        height_m = rng.uniform(*self.start_height_m)
        start_m = perceived[:3] + np.array([*rng.uniform(-1, 1, 2) * self.start_range_m, height_m])
        direction = rng.uniform(0.0, 2.0 * math.pi)
        tilt_rad = rng.uniform(0.0, self.start_tilt_rad)
        tilt = exp_so3(tilt_rad * np.array([math.cos(direction), math.sin(direction), 0.0]))
        start = make_pose(start_m, tilt @ _INTO_HOLE)
        return Scene(q_start_rad=joints_at(model, start), T_base_goal=goal, T_base_goal_perceived=perceived)

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        """Put the block where the scene has its hole, and the arm at its start."""
        mujoco.mj_resetData(model, data)
        data.qpos[:] = scene.q_start_rad
        block = compose(scene.T_base_goal, make_pose(np.zeros(3), _INTO_HOLE.T))
        data.mocap_pos[0], data.mocap_quat[0] = block[:3], block[3:]
        mujoco.mj_forward(model, data)

    def contact_zone(self, scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """The block around the perceived hole, and a little above it."""
        goal_m = scene.T_base_goal_perceived[:3]
        return goal_m - np.array([_ZONE_M, _ZONE_M, self.hole_depth_m]), goal_m + np.array([_ZONE_M, _ZONE_M, 0.01])

    def referee(self, scene: Scene) -> "PegReferee":
        """Who judges one attempt by the depth of the tip."""
        return PegReferee(self, scene)


class PegReferee:
    """Looks where the tip is: how deep in the hole, and nothing of how it got there."""

    is_lost = False  # A peg can be taken out and tried again.

    def __init__(self, task: PegInsertion, scene: Scene) -> None:
        """Judge one attempt at a scene."""
        self._task, self._goal_m, self._R_base_goal = task, scene.T_base_goal[:3], rotation_of(scene.T_base_goal[3:])
        self._tip_m = np.array([0.0, 0.0, -np.inf])

    def see(self, T_base_tcp: Float[np.ndarray, "n 7"], wrench: Float[np.ndarray, "n 6"]) -> None:
        """Take in what has happened; only the last counts."""
        if len(T_base_tcp):
            self._tip_m = (T_base_tcp[-1, :3] - self._goal_m) @ self._R_base_goal

    @property
    def progress(self) -> float:
        """Depth of the tip in the hole over the depth that counts as inserted, from 0 to 1."""
        x, y, depth_m = self._tip_m
        if math.hypot(x, y) > 3.0 * self._task.clearance_m:
            return 0.0
        return min(max(depth_m / self._task.success_depth_m, 0.0), 1.0)

    @property
    def failure(self) -> str:
        """`jammed` with the tip in the hole, `missed` with it on the block, else `timeout`."""
        if self.progress > 0.05:
            return "jammed"
        return "missed" if self._tip_m[2] > -0.001 else "timeout"
