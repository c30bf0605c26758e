"""Surface wiping: 8 N held along a way on a plate whose height and tilt are other than they seem."""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.rig import Rig
from wrenchflow.sim.panda import ARM_CONTYPE, WORLD_CONTYPE, make_arm
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.sim.tasks.wiping_path import BEGIN_M, END_M, aside
from wrenchflow.sim.tasks.wiping_referee import Evenness, WipingReferee
from wrenchflow.spatial import compose, exp_so3, make_pose, quat_of, rotation_of

# The goal's frame lies on the plate where the tool should land, with z into it, as the tool's: a half turn about x.
_INTO_PLATE = exp_so3(np.array([math.pi, 0.0, 0.0]))
# The way goes along the base's y: along x the damping, which follows the arm's inertia, couples speed to the press.
_ACROSS = exp_so3(np.array([0.0, 0.0, math.pi / 2.0]))
_PLATE_M = (0.125, 0.075, 0.012)  # Half sizes; its middle is that of the way.
_ZONE_M = 0.03  # Around the way, for the tool may land beside it, and the surface be higher.
_STRIPES = 30
_HOLDER, _PAD = (0.4, 0.42, 0.45, 1.0), (0.95, 0.7, 0.25, 1.0)
_PLATE, _WAY, _STAND = (0.32, 0.46, 0.62, 1.0), (0.93, 0.93, 0.92, 1.0), (0.66, 0.68, 0.72, 1.0)


@dataclass(frozen=True, kw_only=True)
class SurfaceWiping:
    """A plate somewhere near, a guess of where it is, and a way on it, along which 8 N have to be held.

    Geometry: the pad is a sphere of 25 mm whose lowest point is the TCP, the plate a box with its face in the goal's
    plane, so there is one contact, and a pad that is not level touches where it is round: 1 mm nearer the edge for
    every 2.3 degrees. The goal's frame lies where the tool should land, with z into the surface. From there the way
    swings by 10 mm about the goal's x (`wiping_path`): 30 mm of run-in, where the press may rise, then 120 mm that
    count.

    Randomisation, uniform: where the landing seems to be within 25 mm and 15 degrees about the vertical; the surface
    up to 10 mm higher or lower than it seems, and tilted by up to 5 degrees any way, by which the end of the way is off
    by another 13 mm. The plane of the goal is perceived as level; where the way runs in it is known. The tool starts 35
    to 55 mm above the perceived goal, up to 20 mm aside.

    Clearances: +-2 N at 600 N/m are 3.3 mm of height. Beside the way 5 mm are allowed, 16 N are too much anywhere.

    Contact: friction 0.3, which holds the tool back by mu F / K = 4 mm of lead. The pad gives way as rubber does, by a
    third of a millimetre at 8 N: its force grows from nothing over the first millimetre (solimp), so that a landing at
    15 mm/s does not press harder than what follows, one at 30 mm/s presses with 22 N.

    What force is for: pressed as deep as where the surface seems to be asks for, 25 of 200 attempts are a success, by
    luck of the height. A spring that leads the tool by F / K wherever it is presses right at any height, but what does
    not feel the contact comes down as fast as it leads: 19 N at the landing, and 18 of 20 attempts end by
    `over-force`. By feel, 120 of 120 are a success; the press is off by 0.5 N (RMS), 1.8 N at most.
    """

    name: str = "surface-wiping"
    rig: str = "panda_wiper"
    phases: tuple[str, ...] = ("approach", "land", "press", "wipe")
    failures: tuple[str, ...] = ("uneven", "lifted", "off-path", "over-force", "timeout")
    time_limit_s: float = 15.0
    pad_radius_m: float = 0.025
    centre_m: tuple[float, float, float] = (0.50, -0.075, 0.12)  # middle of where the landing seems to be
    position_range_m: float = 0.025
    yaw_range_rad: float = math.radians(15.0)
    height_range_m: float = 0.010  # by which the surface is higher or lower than it seems
    tilt_max_rad: float = math.radians(5.0)  # by which it is tilted, any way; it seems to be level
    start_height_m: tuple[float, float] = (0.035, 0.055)
    start_range_m: float = 0.020
    start_tilt_rad: float = math.radians(1.0)
    friction: float = 0.3
    pad_solref: tuple[float, float] = (0.004, 1.0)
    pad_solimp: tuple[float, float, float, float, float] = (0.0, 0.95, 0.001, 0.5, 2.0)
    evenness: Evenness = field(default_factory=Evenness)

    @property
    def force_limit_n(self) -> float:
        """What spoils the surface [N]."""
        return self.evenness.force_max_n

    def make_spec(self, rig: Rig) -> mujoco.MjSpec:
        """The arm with the wiper below its sensor, and the plate as a body that can be moved."""
        spec = make_arm(rig)
        self._add_wiper(spec, rig)
        self._add_plate(spec)
        return spec

    def _contact(self) -> dict:
        return {
            "friction": [self.friction, 0.0, 0.0],
            "solref": list(self.pad_solref),
            "solimp": list(self.pad_solimp),
            "condim": 3,
        }

    def _add_wiper(self, spec: mujoco.MjSpec, rig: Rig) -> None:
        tool, flange = spec.body("tool"), spec.body("flange")
        mass_kg, com_m = rig.payload.mass_kg, rig.payload.com_sensor_m
        sensor_z = rig.sensor.T_flange_sensor[2]
        length_m = rig.T_flange_tcp[2] - sensor_z
        tool.explicitinertial = True
        tool.mass, tool.ipos = mass_kg, list(com_m)
        # As a uniform rod of the pad's radius: its own small inertia hardly matters beside the arm's.
        across = mass_kg * (3.0 * self.pad_radius_m**2 + length_m**2) / 12.0
        tool.fullinertia = [across, across, mass_kg * self.pad_radius_m**2 / 2.0, 0, 0, 0]
        looks = {"contype": 0, "conaffinity": 0, "mass": 0.0, "type": mujoco.mjtGeom.mjGEOM_CYLINDER}
        middle_m = length_m - self.pad_radius_m
        flange.add_geom(fromto=[0, 0, 0, 0, 0, sensor_z], size=[0.035, 0, 0], rgba=[0.2, 0.2, 0.22, 1], **looks)
        tool.add_geom(fromto=[0, 0, 0, 0, 0, 0.03], size=[0.028, 0, 0], rgba=_HOLDER, **looks)
        cup_m = self.pad_radius_m + 0.001  # The upper half of the pad sits in it.
        tool.add_geom(fromto=[0, 0, 0.03, 0, 0, middle_m - cup_m], size=[0.012, 0, 0], rgba=_STAND, **looks)
        tool.add_geom(fromto=[0, 0, middle_m - cup_m, 0, 0, middle_m], size=[cup_m, 0, 0], rgba=_HOLDER, **looks)
        tool.add_geom(
            name="pad",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[0, 0, middle_m],
            size=[self.pad_radius_m, 0, 0],
            rgba=_PAD,
            contype=ARM_CONTYPE,
            conaffinity=WORLD_CONTYPE,
            mass=0.0,
            **self._contact(),
        )

    def _add_plate(self, spec: mujoco.MjSpec) -> None:
        plate = spec.worldbody.add_body(name="plate", mocap=True, pos=list(self.centre_m))
        plate.add_site(name="goal", quat=list(quat_of(_INTO_PLATE)), size=[0.001, 0.001, 0.001])
        middle_m = END_M / 2.0
        plate.add_geom(
            name="plate",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[middle_m, 0.0, -_PLATE_M[2]],
            size=list(_PLATE_M),
            rgba=_PLATE,
            contype=WORLD_CONTYPE,
            conaffinity=ARM_CONTYPE,
            **self._contact(),
        )
        # What can only be seen is a body of its own, which the search for contacts passes over.
        marks = plate.add_body(name="marks")
        looks = {"contype": 0, "conaffinity": 0, "mass": 0.0}
        stand_m = (self.centre_m[2] - 2.0 * _PLATE_M[2]) / 2.0
        marks.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            pos=[middle_m, 0.0, -2.0 * _PLATE_M[2] - stand_m],
            size=[0.03, stand_m, 0],
            rgba=_STAND,
            **looks,
        )
        edges = np.linspace(BEGIN_M, END_M, _STRIPES + 1)
        for x, until in pairwise(edges):
            marks.add_geom(  # The plate's y points the other way.
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[x, -aside(x), -0.0015, until, -aside(until), -0.0015],
                size=[0.002, 0, 0],
                rgba=_WAY,
                **looks,
            )

    def draw(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scene:
        """Draw where the surface is, where it seems to be, and where the tool starts."""
        offset_m = np.array([*rng.uniform(-1, 1, 2) * self.position_range_m, 0.0])
        yaw = exp_so3(np.array([0.0, 0.0, rng.uniform(-1, 1) * self.yaw_range_rad])) @ _ACROSS
        perceived = make_pose(np.array(self.centre_m) + offset_m, yaw @ _INTO_PLATE)
        height_m = rng.uniform(-1, 1) * self.height_range_m
        tilt = _tilt(rng, self.tilt_max_rad)
        goal = make_pose(perceived[:3] + np.array([0.0, 0.0, height_m]), tilt @ yaw @ _INTO_PLATE)
        above_m = np.array([*rng.uniform(-1, 1, 2) * self.start_range_m, rng.uniform(*self.start_height_m)])
        start = make_pose(perceived[:3] + above_m, _tilt(rng, self.start_tilt_rad) @ yaw @ _INTO_PLATE)
        return Scene(q_start_rad=joints_at(model, start), T_base_goal=goal, T_base_goal_perceived=perceived)

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        """Put the plate where the scene has its surface, and the arm at its start."""
        mujoco.mj_resetData(model, data)
        data.qpos[:] = scene.q_start_rad
        plate = compose(scene.T_base_goal, make_pose(np.zeros(3), _INTO_PLATE.T))
        data.mocap_pos[0], data.mocap_quat[0] = plate[:3], plate[3:]
        mujoco.mj_forward(model, data)

    def contact_zone(self, scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """A box around the perceived way, higher and lower by more than the surface may be off at its end."""
        way = np.linspace(0.0, END_M, _STRIPES)
        points = np.stack([way, [aside(x) for x in way], np.zeros(_STRIPES)], axis=-1)
        goal = scene.T_base_goal_perceived
        corners_m = goal[:3] + points @ rotation_of(goal[3:]).T
        return corners_m.min(axis=0) - _ZONE_M, corners_m.max(axis=0) + _ZONE_M

    def referee(self, scene: Scene) -> WipingReferee:
        """Who judges one attempt by how even the force was along the way."""
        return WipingReferee(scene.T_base_goal, self.evenness)


def _tilt(rng: np.random.Generator, most_rad: float) -> Float[np.ndarray, "3 3"]:
    """A rotation by up to an angle about any axis that lies level."""
    direction, angle = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, most_rad)
    return exp_so3(angle * np.array([math.cos(direction), math.sin(direction), 0.0]))
