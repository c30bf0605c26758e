"""Which ways to hold a tool so that its weight is felt in every direction, within what the arm can reach."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from wrenchflow.errors import CalibrationError
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.payload import MAX_CONDITION, condition_of, equations
from wrenchflow.rig import Rig
from wrenchflow.spatial import exp_so3, log_so3, make_pose, rotation_of

_TILTS_RAD = (0.25, 0.5, 0.75)
_AZIMUTHS = 12
_NOTHING = 1e-6 * np.eye(10)  # What is known before the first pose: next to nothing, yet with a determinant.


# Whether an arm can bring its tool from one T_base_tcp to another.
Reach = Callable[[Float[np.ndarray, " 7"], Float[np.ndarray, " 7"]], bool]


def plan_poses(rig: Rig, home: Float[np.ndarray, " 7"], count: int, can_go: Reach) -> Float[np.ndarray, "k 7"]:
    """Poses of the tcp in the order in which they are gone to, the first of them `home`; the tip stays where it is.

    One after the other is taken what tells the most besides those that there are (the largest determinant of the
    least squares' normal matrix); then the shortest way is gone, each time to the nearest.

    Args:
        rig: Sensor and mount.
        home: T_base_tcp that the tool is tilted from. Shape (7,).
        count: How many.
        can_go: What the arm can do.

    Raises:
        CalibrationError: If the arm cannot reach enough of them to tell a payload.
    """
    candidates = np.array([home, *(pose for pose in _tilted(home) if can_go(home, pose))])
    if len(candidates) < count:
        raise CalibrationError(
            f"the arm reaches {len(candidates)} ways to hold the tool around the middle of its workspace, "
            f"expected {count} at least."
        )
    mount = SensorMount(rig)
    told = [A.T @ A for A in equations(mount.orientation(candidates[:, 3:]))]
    chosen = [0]
    while len(chosen) < count:
        known = _NOTHING + sum(told[i] for i in chosen)
        gain = [-np.inf if i in chosen else float(np.linalg.slogdet(known + new)[1]) for i, new in enumerate(told)]
        chosen.append(int(np.argmax(gain)))
    poses = _ordered(candidates[chosen])
    condition = condition_of(mount.orientation(poses[:, 3:]))
    if not condition < MAX_CONDITION:
        raise CalibrationError(
            f"the arm cannot tilt the tool enough: got a condition number of {condition:.3g} with {count} poses, "
            f"expected less than {MAX_CONDITION:g}."
        )
    return poses


def _tilted(home: Float[np.ndarray, " 7"]) -> list[Float[np.ndarray, " 7"]]:
    """The tool tilted any way about its tip."""
    R_home, poses = rotation_of(home[3:]), []
    for tilt in _TILTS_RAD:
        for azimuth in np.arange(_AZIMUTHS) * (2.0 * np.pi / _AZIMUTHS):
            turn = exp_so3(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
            poses.append(make_pose(home[:3], turn @ R_home))
    return poses


def turn_between(start: Float[np.ndarray, " 7"], stop: Float[np.ndarray, " 7"]) -> float:
    """Angle between the orientations of two poses [rad]."""
    return float(np.linalg.norm(log_so3(rotation_of(start[3:]).T @ rotation_of(stop[3:]))))


def _ordered(poses: Float[np.ndarray, "k 7"]) -> Float[np.ndarray, "k 7"]:
    """The same, each the nearest to the one before it."""
    way, left = [poses[0]], list(poses[1:])
    while left:
        nearest = int(np.argmin([turn_between(way[-1], pose) for pose in left]))
        way.append(left.pop(nearest))
    return np.array(way)
