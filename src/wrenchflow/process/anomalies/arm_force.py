"""The force that the arm's joints feel: a second witness, by which the sensor's sign, frame and drift can be judged.

tau_ext = J^T w, seven equations for six unknowns, solved by least squares. The Jacobian is that of the Panda's table,
and only used where that table leads to the recorded poses.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import StreamError
from wrenchflow.kinematics import jacobians
from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import held_pose
from wrenchflow.signals import ARM_JOINTS

_EVERY_NS = 20_000_000
_NEAR_M = 0.002  # Of the pose that joint angles and table lead to, from the recorded one.
_MIN = 25  # Means.


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmForce:
    """Means over 20 ms of what two witnesses say, both in the sensor's axes, the payload's weight in none of them.

    Attributes:
        t: Middle of each [ns]. Shape (k,).
        sensor: The sensor's force, its bias still in it [N]. Shape (k, 3).
        joints: The force that the joints feel [N]. Shape (k, 3).
        up: What one kilogram at rest makes the sensor read [N]. Shape (k, 3).
    """

    t: Int64[np.ndarray, " k"]
    sensor: Float[np.ndarray, "k 3"]
    joints: Float[np.ndarray, "k 3"]
    up: Float[np.ndarray, "k 3"]


def arm_force(look: Look) -> ArmForce | str:
    """What both witnesses say, or why there is no second one."""
    streams = look.episode.streams
    for name in ("external_torque", "joint_states", "tcp_pose"):
        if name not in streams or not len(streams[name]):
            return f"there is no stream '{name}'"
    torque, joints, pose = streams["external_torque"], streams["joint_states"], streams["tcp_pose"]
    if torque.data.shape[1] != ARM_JOINTS or joints.data.shape[1] != 3 * ARM_JOINTS:
        return f"the arm has {torque.data.shape[1]} joints, and only a Panda's kinematics are known"
    t_ns = look.t
    if len(t_ns) < 2:
        return "there are too few samples"
    edges = np.arange(max(t_ns[0], torque.t[0], joints.t[0], pose.t[0]), t_ns[-1], _EVERY_NS)
    rows = [np.searchsorted(stream.t, edges) for stream in (look.raw, torque, joints)]
    full = np.all([np.diff(row) > 0 for row in rows], axis=0)
    if full.sum() < _MIN:
        return f"there are {int(full.sum()) * _EVERY_NS * 1e-9:.2g} s in which sensor and joints speak"
    sensor, tau, q = (
        # What begins after the last sample is empty, and is left out with all that is not full.
        np.add.reduceat(data[: row[-1]], np.minimum(row[:-1], row[-1] - 1), axis=0)[full] / np.diff(row)[full, None]
        for data, row in zip((look.data, torque.data, joints.data[:, :ARM_JOINTS]), rows, strict=True)
    )
    middle = (edges[:-1] + _EVERY_NS // 2)[full]
    try:
        _, held = held_pose(pose, middle)
    except StreamError as error:
        return str(error)
    tip_m, J = jacobians(q, np.array(look.rig.T_flange_tcp))
    off_m = float(np.median(np.linalg.norm(tip_m - held[:, :3], axis=1)))
    if off_m > _NEAR_M:
        return f"the Panda's kinematics lead {off_m * 1e3:.0f} mm beside the recorded poses"
    # Least squares by the normal equations: J is far from singular where an arm works.
    wrench = np.linalg.solve(J @ J.transpose(0, 2, 1), J @ tau[:, :, None])[:, :, 0]
    mount = SensorMount(look.rig)
    R = mount.orientation(held[:, 3:])
    felt = np.einsum("kji,kj->ki", R, wrench[:, :3])
    return ArmForce(t=middle, sensor=sensor[:, :3] - mount.weight(R)[:, :3], joints=felt, up=9.81 * R[:, 2, :])
