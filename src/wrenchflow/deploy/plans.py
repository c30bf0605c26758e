"""Plans with time stamps, and the reference that follows them: never by index, so a late plan is a shorter plan."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import ControlError
from wrenchflow.spatial import interpolate_pose

_LEAD_NS = 5_000_000  # A waypoint that is nearer than this cannot be reached without a jump.


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Where to be, and when.

    Attributes:
        t_obs_ns: Stamp of the observation that it was made from.
        t: Stamps of the waypoints [ns], increasing. Shape (n,).
        poses: Target poses in the base frame. Shape (n, 7).
    """

    t_obs_ns: int
    t: Int64[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 7"]

    def __post_init__(self) -> None:
        # From here on a pose moves an arm: what is no pose is refused, whoever made it.
        if not np.isfinite(self.poses).all():
            raise ControlError(f"the plan made at {self.t_obs_ns} ns has a pose that is not finite.")
        if len(self.t) == 0 or (np.diff(self.t) <= 0).any():
            raise ControlError(f"the plan made at {self.t_obs_ns} ns needs increasing stamps, got {self.t.tolist()}.")


class PlanFollower:
    """The target as a function of time: along the newest plan from wherever it is, then still at the plan's end."""

    def __init__(self, pose: Float[np.ndarray, " 7"], t_ns: int) -> None:
        """Begin at a pose, and stay there until a plan comes."""
        self._t, self._poses = np.array([t_ns]), pose[None].copy()

    def accept(self, plan: Plan, now_ns: int) -> int:
        """Follow a plan that arrives at `now_ns`; the target goes on from where it is then.

        Returns:
            How many of its waypoints had passed, or come too soon to be reached, and were dropped. If all had, the
            target stays on its old way.
        """
        kept = plan.t > now_ns + _LEAD_NS
        if kept.any():
            here = self.target(now_ns)
            self._t = np.concatenate([[now_ns], plan.t[kept]])
            self._poses = np.concatenate([here[None], plan.poses[kept]])
        return int((~kept).sum())

    def target(self, t_ns: int) -> Float[np.ndarray, " 7"]:
        """The target pose at a time."""
        after = int(np.searchsorted(self._t, t_ns, side="right"))
        if after == len(self._t) or after == 0:
            return self._poses[min(after, len(self._t) - 1)].copy()
        start_ns, stop_ns = self._t[after - 1], self._t[after]
        weight = np.array((t_ns - start_ns) / (stop_ns - start_ns))
        return interpolate_pose(self._poses[after - 1], self._poses[after], weight)
