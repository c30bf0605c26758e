"""The damping design against scipy's generalised eigenvalues, and what it promises about every mode."""

import numpy as np
import pytest
import scipy.linalg

from wrenchflow.control.damping import design_damping

REGULARISATION = 1e-6


def arm(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random Jacobian and joint inertia."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(7, 7))
    return rng.normal(size=(6, 7)), root @ root.T + np.eye(7)


def stiffness(seed: int, scale: float) -> np.ndarray:
    rng = np.random.default_rng(seed + 1000)
    root = rng.normal(size=(3, 3))
    return scale * (root @ root.T + 0.1 * np.eye(3))


def designed(J, M, K_lin, K_rot, damping_ratio=0.9):
    D, P = np.full((6, 6), np.nan), np.full((6, 7), np.nan)
    design_damping(J, M, K_lin, K_rot, damping_ratio, D, P, np.full((6, 6), np.nan))
    return D, P


def test_the_inertia_that_is_felt_is_that_of_each_half():
    J, M = arm(3)
    inertia = np.full((6, 6), np.nan)
    design_damping(J, M, 400.0 * np.eye(3), 20.0 * np.eye(3), 0.9, np.empty((6, 6)), np.empty((6, 7)), inertia)
    mobility = J @ np.linalg.solve(M, J.T) + REGULARISATION * np.eye(6)
    for half in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(inertia[half, half], np.linalg.inv(mobility[half, half]), rtol=1e-9)
    assert (inertia[:3, 3:] == 0.0).all()
    assert (inertia[3:, :3] == 0.0).all()


@pytest.mark.parametrize("seed", range(20))
def test_each_half_is_damped_by_double_diagonalisation(seed):
    (J, M), K = arm(seed), (stiffness(seed, 400.0), stiffness(seed + 1, 20.0))
    D, _ = designed(J, M, *K)
    mobility = J @ np.linalg.solve(M, J.T) + REGULARISATION * np.eye(6)
    for half, K_half in ((slice(0, 3), K[0]), (slice(3, 6), K[1])):
        inertia = np.linalg.inv(mobility[half, half])
        squares, V = scipy.linalg.eigh(K_half, inertia)
        Q = inertia @ V
        np.testing.assert_allclose(D[half, half], 2.0 * 0.9 * Q * np.sqrt(squares) @ Q.T, rtol=1e-9, atol=1e-9)
        # Every mode has the ratio that was asked for.
        np.testing.assert_allclose(V.T @ D[half, half] @ V, np.diag(2.0 * 0.9 * np.sqrt(squares)), atol=1e-8)
    assert (D[:3, 3:] == 0.0).all()
    assert (D[3:, :3] == 0.0).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_nullspace_map_takes_joint_torque_to_its_share_of_the_task(seed):
    J, M = arm(seed)
    _, P = designed(J, M, np.eye(3), np.eye(3))
    mobility = J @ np.linalg.solve(M, J.T) + REGULARISATION * np.eye(6)
    np.testing.assert_allclose(P, np.linalg.solve(mobility, J @ np.linalg.inv(M)), rtol=1e-8, atol=1e-9)
    # What is left of a joint torque once its share is taken out does not accelerate the task.
    tau = np.random.default_rng(seed).normal(size=7)
    left = tau - J.T @ (P @ tau)
    np.testing.assert_allclose(J @ np.linalg.solve(M, left), 0.0, atol=1e-4)


def test_a_stiffness_of_zero_needs_no_damping_and_a_soft_axis_little():
    J, M = arm(0)
    D, _ = designed(J, M, np.zeros((3, 3)), np.zeros((3, 3)))
    np.testing.assert_array_equal(D, np.zeros((6, 6)))
    D, _ = designed(J, M, np.diag([0.0, 0.0, 400.0]), 25.0 * np.eye(3))
    assert np.linalg.matrix_rank(D[:3, :3], tol=1e-6) == 1


def test_damping_is_symmetric_and_takes_energy_out_only():
    for seed in range(10):
        D, _ = designed(*arm(seed), stiffness(seed, 400.0), stiffness(seed, 20.0))
        np.testing.assert_allclose(D, D.T, atol=1e-9)
        assert np.linalg.eigvalsh(D).min() > -1e-9


def test_a_singular_pose_gives_finite_damping():
    J, M = arm(0)
    J[2] = 0.0
    J[5] = J[4]
    D, P = designed(J, M, 600.0 * np.eye(3), 25.0 * np.eye(3))
    assert np.isfinite(D).all()
    assert np.isfinite(P).all()


def test_at_the_usual_poses_explicit_integration_of_the_damping_is_stable(peg_plant):
    for seed in range(5):
        plant, controller, _ = peg_plant(seed)
        plant.advance(controller, 1)
        J, M, D = controller.obs["J"][0], controller.obs["M"][0], controller.ctl["D"][0]
        mobility = J @ np.linalg.solve(M, J.T)
        assert 0.001 * np.abs(np.linalg.eigvals(mobility @ D)).max() < 1.0
