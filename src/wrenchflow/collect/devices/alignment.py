"""The gate before a leader arm: the follower stays where it is until both arms stand alike."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.config import require_positive
from wrenchflow.spatial import log_so3, rotation_of


@dataclass(frozen=True, kw_only=True)
class AlignmentLimits:
    """How far leader and follower may differ when the follower begins to follow.

    Attributes:
        joint_rad: In any joint.
        position_m: Of the tool.
        rotation_rad: Of the tool.
    """

    joint_rad: float = 0.8
    position_m: float = 0.05
    rotation_rad: float = 0.2

    def __post_init__(self) -> None:
        require_positive(joint_rad=self.joint_rad, position_m=self.position_m, rotation_rad=self.rotation_rad)


class AlignmentGate:
    """Closed at first; open from when the arms stood alike until it is closed again.

    Attributes:
        is_open: Whether the follower may follow.
    """

    def __init__(self, limits: AlignmentLimits) -> None:
        self.is_open, self._limits = False, limits

    def close(self) -> None:
        """Ask for the arms to stand alike again."""
        self.is_open = False

    def look(
        self,
        leader_rad: Float[np.ndarray, " n"],
        follower_rad: Float[np.ndarray, " m"],
        leader_pose: Float[np.ndarray, " 7"],
        follower_pose: Float[np.ndarray, " 7"],
    ) -> str:
        """Compare the arms, and open if they stand alike.

        Args:
            leader_rad: Joint angles of the leader.
            follower_rad: Joint angles of the follower; joints are compared where both arms have as many.
            leader_pose: Where the leader has its tool, T_base_tcp.
            follower_pose: Where the follower has its own.

        Returns:
            Why the gate is closed, with what has to move how far; empty if it is open.
        """
        limits, wrong = self._limits, []
        if self.is_open:
            return ""
        if len(leader_rad) == len(follower_rad):
            apart = np.abs(leader_rad - follower_rad)
            wrong += [f"joint {i + 1} by {apart[i]:.2f} rad" for i in np.flatnonzero(apart >= limits.joint_rad)]
        position_m = float(np.linalg.norm(leader_pose[:3] - follower_pose[:3]))
        turn = rotation_of(leader_pose[3:]) @ rotation_of(follower_pose[3:]).T
        rotation_rad = float(np.linalg.norm(log_so3(turn)))
        if position_m >= limits.position_m:
            wrong.append(f"the tool by {100.0 * position_m:.1f} cm")
        if rotation_rad >= limits.rotation_rad:
            wrong.append(f"the tool by {np.degrees(rotation_rad):.0f} degrees")
        self.is_open = not wrong
        if self.is_open:
            return ""
        return (
            f"leader and follower differ in {', '.join(wrong)}; move the leader until it is less than "
            f"{limits.joint_rad:g} rad, {100.0 * limits.position_m:g} cm and "
            f"{np.degrees(limits.rotation_rad):.0f} degrees"
        )
