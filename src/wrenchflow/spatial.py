"""Poses, rotations, and the change of frame of wrenches and twists.

A pose is seven numbers, position [m] and unit quaternion (wxyz); `T_a_b` is the pose of frame b in frame a. Rotations
are the control core's own kernels: one source for the loop and for files, the same bits for one pose and for many.
Everything takes any number of leading axes.
"""

import numpy as np
from jaxtyping import Float

from wrenchflow import so3

IDENTITY_POSE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def _contiguous(array: np.ndarray, *shape: int) -> np.ndarray:
    return np.ascontiguousarray(array, np.float64).reshape(-1, *shape)


def rotation_of(quat_wxyz: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotation matrices of quaternions."""
    out = np.empty((*quat_wxyz.shape[:-1], 3, 3))
    so3.matrices_of_quats(_contiguous(quat_wxyz, 4), out.reshape(-1, 3, 3))
    return out


def quat_of(rotation: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 4"]:
    """Unit quaternions (wxyz, w >= 0) of rotation matrices."""
    out = np.empty((*rotation.shape[:-2], 4))
    so3.quats_of_matrices(_contiguous(rotation, 3, 3), out.reshape(-1, 4))
    return out


def exp_so3(rotvec_rad: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotation matrices of rotation vectors [rad]."""
    out = np.empty((*rotvec_rad.shape[:-1], 3, 3))
    so3.matrices_of_vectors(_contiguous(rotvec_rad, 3), out.reshape(-1, 3, 3))
    return out


def log_so3(rotation: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 3"]:
    """Rotation vectors [rad], of length pi at most, of rotation matrices."""
    out = np.empty((*rotation.shape[:-2], 4))
    so3.vectors_of_matrices(_contiguous(rotation, 3, 3), out.reshape(-1, 4))
    return out[..., :3]


def rot6d_of(rotation: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 6"]:
    """First two columns of rotation matrices, one after the other.

    Source: Zhou et al., *On the Continuity of Rotation Representations in Neural Networks* (2019).
    """
    return np.concatenate([rotation[..., :, 0], rotation[..., :, 1]], axis=-1)


def rotation_of_rot6d(rot6d: Float[np.ndarray, "*n 6"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotation matrices nearest, by Gram-Schmidt, to six numbers that a network put out."""
    x = rot6d[..., :3] / np.linalg.norm(rot6d[..., :3], axis=-1, keepdims=True)
    y = rot6d[..., 3:] - (x * rot6d[..., 3:]).sum(-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, cross(x, y)], axis=-1)


def make_pose(
    position_m: Float[np.ndarray, "*n 3"], rotation: Float[np.ndarray, "*n 3 3"]
) -> Float[np.ndarray, "*n 7"]:
    """Poses of positions [m] and rotation matrices."""
    return np.concatenate([position_m, quat_of(rotation)], axis=-1)


def compose(T_a_b: Float[np.ndarray, "*n 7"], T_b_c: Float[np.ndarray, "*m 7"]) -> Float[np.ndarray, "*k 7"]:
    """T_a_c = T_a_b T_b_c; leading axes broadcast."""
    R_a_b = rotation_of(T_a_b[..., 3:])
    position_m = T_a_b[..., :3] + (R_a_b @ T_b_c[..., :3, None])[..., 0]
    return make_pose(position_m, R_a_b @ rotation_of(T_b_c[..., 3:]))


def inverse(T_a_b: Float[np.ndarray, "*n 7"]) -> Float[np.ndarray, "*n 7"]:
    """T_b_a of T_a_b."""
    R_b_a = np.swapaxes(rotation_of(T_a_b[..., 3:]), -1, -2)
    return make_pose(-(R_b_a @ T_a_b[..., :3, None])[..., 0], R_b_a)


def cross(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*k 3"]:
    """Vector product of three-vectors; leading axes broadcast."""
    # numpy's own moves axes about for generality, at ten times the cost of the six products for one vector.
    ax, ay, az, bx, by, bz = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def rotate_screw(R_a_b: Float[np.ndarray, "*n 3 3"], screw: Float[np.ndarray, "*m 6"]) -> Float[np.ndarray, "*k 6"]:
    """Express a wrench or a twist, given in the axes of b, in the axes of a. The reference point stays."""
    first = (R_a_b @ screw[..., :3, None])[..., 0]
    second = (R_a_b @ screw[..., 3:, None])[..., 0]
    return np.concatenate([first, second], axis=-1)


def move_wrench(wrench: Float[np.ndarray, "*n 6"], r_m: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*k 6"]:
    """Refer a wrench to another point: force stays, t_new = t - r x f.

    Args:
        wrench: Force [N] and moment [N.m] about the old point. Shape (..., 6).
        r_m: New point minus old point [m], in the wrench's axes. Shape (..., 3).
    """
    force = wrench[..., :3]
    moment = wrench[..., 3:] - cross(r_m, force)
    return np.concatenate([np.broadcast_to(force, moment.shape), moment], axis=-1)


def move_twist(twist: Float[np.ndarray, "*n 6"], r_m: Float[np.ndarray, "*m 3"]) -> Float[np.ndarray, "*k 6"]:
    """Refer a twist to another point of the same body: v_new = v + w x r."""
    angular = twist[..., 3:]
    linear = twist[..., :3] + cross(angular, r_m)
    return np.concatenate([linear, np.broadcast_to(angular, linear.shape)], axis=-1)


def interpolate_pose(
    start: Float[np.ndarray, "*n 7"], stop: Float[np.ndarray, "*n 7"], weight: Float[np.ndarray, "*n"]
) -> Float[np.ndarray, "*n 7"]:
    """Position by line and rotation by slerp, from `start` (weight 0) to `stop` (weight 1).

    The signs of the quaternions do not matter. A weight of exactly 0 or 1 gives that end back, bit for bit, so that a
    grid which falls on samples changes nothing.
    """
    R_start = rotation_of(start[..., 3:])
    turn = log_so3(np.swapaxes(R_start, -1, -2) @ rotation_of(stop[..., 3:]))
    position_m = start[..., :3] + weight[..., None] * (stop[..., :3] - start[..., :3])
    between = make_pose(position_m, R_start @ exp_so3(weight[..., None] * turn))
    return np.where((weight == 0.0)[..., None], start, np.where((weight == 1.0)[..., None], stop, between))
