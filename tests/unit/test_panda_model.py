"""The arm's model against the published numbers, worked out here apart from MuJoCo."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

# Modified DH after Craig: a [m], d [m], alpha [rad] a joint.
A = np.array([0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088])
D = np.array([0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0])
ALPHA = np.array([0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0]) * np.pi / 2
FLANGE_M = 0.107
# Links 1 to 7: mass [kg], centre of mass [m], ixx iyy izz ixy ixz iyz [kg m^2] about it.
LINKS = np.array(
    [
        [4.970684, 0.003875, 0.002081, -0.04762, 0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169],
        [0.646926, -0.003141, -0.02872, 0.003495, 0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704],
        [3.228604, 0.027518, 0.039252, -0.066502, 0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805],
        [3.587895, -0.05317, 0.104419, 0.027454, 0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641],
        [1.225946, -0.011953, 0.041065, -0.038437, 0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229],
        [1.666555, 0.060149, -0.014117, -0.010517, 0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341],
        [0.735522, 0.010517, -0.004252, 0.061597, 0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741],
    ]
)
ARMATURE_KG_M2 = 0.1
GRAVITY = np.array([0.0, 0.0, -9.81])


def homogeneous(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.block([[R, p[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def frames(q: np.ndarray) -> list[np.ndarray]:
    """T_base_link of the seven links, then of the flange."""
    T, found = np.eye(4), []
    for a, d, alpha, theta in zip(A, D, ALPHA, q, strict=True):
        screw_x = homogeneous(Rotation.from_rotvec([alpha, 0, 0]).as_matrix(), np.array([a, 0, 0]))
        screw_z = homogeneous(Rotation.from_rotvec([0, 0, theta]).as_matrix(), np.array([0, 0, d]))
        T = T @ screw_x @ screw_z
        found.append(T)
    return [*found, T @ homogeneous(np.eye(3), np.array([0, 0, FLANGE_M]))]


def bodies(q: np.ndarray, rig) -> list[tuple[int, float, np.ndarray, np.ndarray]]:
    """Joints before it, mass, centre of mass and inertia in base axes, of each link and of the tool."""
    T = frames(q)
    found = []
    for i, (mass, cx, cy, cz, xx, yy, zz, xy, xz, yz) in enumerate(LINKS):
        R, inertia = T[i][:3, :3], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        found.append((i + 1, mass, T[i][:3, 3] + R @ [cx, cy, cz], R @ inertia @ R.T))
    # The tool is a rod of the peg's radius from the sensor to the tcp.
    mass, com = rig.payload.mass_kg, np.array(rig.payload.com_sensor_m)
    length = rig.T_flange_tcp[2] - rig.sensor.T_flange_sensor[2]
    across = mass * (3.0 * 0.01**2 + length**2) / 12.0
    R = T[7][:3, :3] @ Rotation.from_quat(rig.sensor.T_flange_sensor[3:], scalar_first=True).as_matrix()
    origin = T[7][:3, 3] + T[7][:3, :3] @ np.array(rig.sensor.T_flange_sensor[:3])
    rod = np.diag([across, across, mass * 0.01**2 / 2.0])
    found.append((7, mass, origin + R @ com, R @ rod @ R.T))
    return found


def jacobians(q: np.ndarray, joints: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular Jacobian of a point that moves with the first `joints` joints."""
    linear, angular = np.zeros((3, 7)), np.zeros((3, 7))
    for j, T in enumerate(frames(q)[:joints]):
        axis = T[:3, 2]
        angular[:, j], linear[:, j] = axis, np.cross(axis, point - T[:3, 3])
    return linear, angular


def inertia_matrix(q: np.ndarray, rig) -> np.ndarray:
    M = ARMATURE_KG_M2 * np.eye(7)
    for joints, mass, com, inertia in bodies(q, rig):
        linear, angular = jacobians(q, joints, com)
        M += mass * linear.T @ linear + angular.T @ inertia @ angular
    return M


def gravity_torque(q: np.ndarray, rig) -> np.ndarray:
    """Torque that holds the arm still."""
    return -sum(mass * jacobians(q, joints, com)[0].T @ GRAVITY for joints, mass, com, _ in bodies(q, rig))


def postures(rig, n: int) -> np.ndarray:
    low, high = np.array(rig.robot.position_min_rad), np.array(rig.robot.position_max_rad)
    return np.random.default_rng(0).uniform(low, high, (n, 7))


def forward(model, q: np.ndarray, dq: np.ndarray | float = 0.0):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, dq
    mujoco.mj_forward(model, data)
    return data


def test_forward_kinematics_is_the_dh_table(peg_model, rig):
    tcp = homogeneous(
        Rotation.from_quat(rig.T_flange_tcp[3:], scalar_first=True).as_matrix(), np.array(rig.T_flange_tcp[:3])
    )
    for q in postures(rig, 50):
        data = forward(peg_model, q)
        for name, T in (("flange", frames(q)[7]), ("tcp", frames(q)[7] @ tcp)):
            np.testing.assert_allclose(data.site(name).xpos, T[:3, 3], atol=1e-12)
            np.testing.assert_allclose(data.site(name).xmat.reshape(3, 3), T[:3, :3], atol=1e-12)


def test_the_ready_pose_points_straight_down_in_front_of_the_base():
    T = frames(np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4]))[7]
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [0.3069, 0.0, 0.5903], atol=1e-4)  # As the manufacturer's own example says.


def test_the_mass_matrix_is_that_of_the_identified_links(peg_model, rig):
    for q in postures(rig, 20):
        data, M = forward(peg_model, q), np.zeros((7, 7))
        mujoco.mj_fullM(peg_model, data, M)
        np.testing.assert_allclose(M, inertia_matrix(q, rig), rtol=1e-9, atol=1e-9)


def test_gravity_is_that_of_the_identified_links_and_is_compensated(peg_model, rig):
    for q in postures(rig, 20):
        data = forward(peg_model, q)
        expected = gravity_torque(q, rig)
        np.testing.assert_allclose(data.qfrc_bias, expected, atol=1e-9)
        np.testing.assert_allclose(data.qfrc_gravcomp, expected, atol=1e-9)


def test_coriolis_torque_is_the_derivative_of_the_mass_matrix(peg_model, rig):
    # c = dM/dt dq - 1/2 d(dq^T M dq)/dq, by central differences of our own M.
    rng, h = np.random.default_rng(1), 1e-5
    for q in postures(rig, 5):
        dq = rng.normal(size=7)
        slopes = np.array(
            [(inertia_matrix(q + h * e, rig) - inertia_matrix(q - h * e, rig)) / (2 * h) for e in np.eye(7)]
        )
        expected = np.einsum("kij,k,j->i", slopes, dq, dq) - 0.5 * np.einsum("kij,i,j->k", slopes, dq, dq)
        data = forward(peg_model, q, dq)
        np.testing.assert_allclose(data.qfrc_bias - data.qfrc_gravcomp, expected, atol=1e-7)


def test_the_model_has_the_limits_of_the_rig(peg_model, rig):
    low, high = peg_model.jnt_range.T
    np.testing.assert_array_equal(low, rig.robot.position_min_rad)
    np.testing.assert_array_equal(high, rig.robot.position_max_rad)
    assert peg_model.jnt_limited.all()
    np.testing.assert_array_equal(peg_model.actuator_ctrlrange, np.outer(rig.robot.torque_nm, [-1, 1]))
    assert peg_model.actuator_ctrllimited.all()
    assert peg_model.opt.timestep == 0.001


def test_a_joint_that_spins_alone_is_slowed_by_what_friction_compensation_leaves(peg_model, rig):
    # 0.1 N.m.s/rad on each joint, whatever the posture: power lost is that times the speeds squared.
    for q in postures(rig, 3):
        dq = np.random.default_rng(2).normal(size=7)
        np.testing.assert_allclose(
            forward(peg_model, q, dq).qfrc_passive - gravity_torque(q, rig), -0.1 * dq, atol=1e-9
        )
    assert (peg_model.dof_frictionloss == 0.0).all()


def test_a_joint_stops_at_its_limit_and_a_motor_at_its_torque(peg_model, rig):
    data = forward(peg_model, np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8]))
    data.ctrl[:] = [0, 0, 0, 0, 0, 0, 1000.0]
    mujoco.mj_forward(peg_model, data)
    assert data.qfrc_actuator[6] == rig.robot.torque_nm[6]
    data.ctrl[6] = 5.0
    mujoco.mj_step(peg_model, data, 2000)
    assert data.qpos[6] == pytest.approx(rig.robot.position_max_rad[6], abs=0.02)


def test_shapes_add_no_mass_to_the_identified_links(peg_model):
    mass = peg_model.body_mass.sum() - peg_model.body("block").mass[0]
    assert mass == pytest.approx(0.629769 + LINKS[:, 0].sum() + 0.45, abs=1e-9)
