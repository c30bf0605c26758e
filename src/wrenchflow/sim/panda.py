"""The Panda as a MuJoCo model of our own: published kinematics, identified inertias, capsules, torque motors.

Sources: `wrenchflow.kinematics` for the table of its joints, `wrenchflow.panda_links` for masses and inertias.
"""

import math

import mujoco
import numpy as np

from wrenchflow.kinematics import DH, FLANGE_M
from wrenchflow.panda_links import LINKS
from wrenchflow.rig import Rig
from wrenchflow.spatial import compose

READY_RAD = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)

# Capsules that cover the links, a link: from [m], to [m], radius [m], in the link's frame. Link 0 first.
CAPSULES = (
    ((-0.08, 0.0, 0.06), (0.0, 0.0, 0.06), 0.06),
    ((0.0, 0.0, -0.19), (0.0, 0.0, 0.0), 0.06),
    ((0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    ((0.0, 0.0, -0.15), (0.0, 0.0, -0.03), 0.055),
    ((0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.055),
    ((0.0, 0.0, -0.25), (0.0, 0.0, -0.03), 0.05),
    ((0.0, 0.0, -0.06), (0.0, 0.0, 0.04), 0.05),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.08), 0.045),
)
ARMATURE_KG_M2 = 0.1  # Rotor inertia seen at the joint.
# What the arm's own friction compensation leaves of viscous friction; simulators of the bare arm usually take 1.0.
DAMPING_NM_S_RAD = 0.1
TIMESTEP_S = 0.001

# Geoms of the arm and of the tool meet the world's (bit 0), never each other.
ARM_CONTYPE, WORLD_CONTYPE = 2, 1
_HALF_TURN = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
_WHITE, _DARK = (0.93, 0.93, 0.92, 1.0), (0.25, 0.27, 0.3, 1.0)


def make_arm(rig: Rig) -> mujoco.MjSpec:
    """Build the arm with its wrist sensor on a bare floor; a task adds what the tool is and what it touches.

    The body `tool` hangs below the sensor: its interaction with the flange is what the sensor reads. Sites: `flange`,
    `sensor` (origin of `tool`) and `tcp`. The simulator compensates gravity itself (`gravcomp`), so that commanded
    torque is without gravity; the sensor still feels the tool's weight.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{rig.robot.name}_arm"
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    world = spec.worldbody
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.84, 0.88],
        rgb2=[0.94, 0.95, 0.96],
        width=64,
        height=384,
    )
    world.add_light(pos=[0.6, -0.6, 1.6], dir=[-0.2, 0.4, -1.0], castshadow=False)
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[1.0, 1.0, 0.05],
        rgba=[0.72, 0.75, 0.78, 1.0],
        contype=WORLD_CONTYPE,
        conaffinity=ARM_CONTYPE,
    )
    parent = world.add_body(name="link0")
    _add_link(parent, 0)
    for i, (a, d, alpha) in enumerate(DH):
        parent = parent.add_body(
            name=f"link{i + 1}",
            pos=[a, -d * math.sin(alpha), d * math.cos(alpha)],
            quat=[math.cos(alpha / 2), math.sin(alpha / 2), 0.0, 0.0],
        )
        parent.add_joint(
            name=f"joint{i + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            range=[rig.robot.position_min_rad[i], rig.robot.position_max_rad[i]],
            armature=ARMATURE_KG_M2,
            damping=np.array([DAMPING_NM_S_RAD, 0.0, 0.0]),
        )
        _add_link(parent, i + 1)
        motor = spec.add_actuator(name=f"motor{i + 1}", target=f"joint{i + 1}")
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_motor()
        motor.ctrlrange = [-rig.robot.torque_nm[i], rig.robot.torque_nm[i]]
    flange = parent.add_body(name="flange", pos=[0, 0, FLANGE_M], gravcomp=1.0)
    flange.add_site(name="flange")
    sensor_pose, tcp_pose = np.array(rig.sensor.T_flange_sensor), np.array(rig.T_flange_tcp)
    tool = flange.add_body(name="tool", pos=sensor_pose[:3], quat=sensor_pose[3:], gravcomp=1.0)
    tool.add_site(name="sensor")
    flange.add_site(name="tcp", pos=tcp_pose[:3], quat=tcp_pose[3:], size=[0.002, 0.002, 0.002])
    for camera in rig.cameras:
        # MuJoCo's cameras look along -z, with y up: half a turn about x.
        pose = compose(np.array(camera.T_parent_camera), _HALF_TURN)
        mount = {"flange": flange, "base": world}[camera.parent]
        fov_deg = math.degrees(camera.fov_y_rad)
        mount.add_camera(name=camera.name, pos=list(pose[:3]), quat=list(pose[3:]), fovy=fov_deg)
    for kind, name in ((mujoco.mjtSensor.mjSENS_FORCE, "force"), (mujoco.mjtSensor.mjSENS_TORQUE, "torque")):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor")
    return spec


def _add_link(body: mujoco.MjsBody, index: int) -> None:
    mass_kg, com_m, inertia = LINKS[index]
    body.explicitinertial = True
    body.mass, body.ipos, body.fullinertia, body.gravcomp = mass_kg, list(com_m), list(inertia), 1.0
    start_m, stop_m, radius_m = CAPSULES[index]
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*start_m, *stop_m],
        size=[radius_m, 0, 0],
        rgba=_DARK if index in (0, 7) else _WHITE,
        contype=ARM_CONTYPE,
        conaffinity=WORLD_CONTYPE,
        mass=0.0,
    )
