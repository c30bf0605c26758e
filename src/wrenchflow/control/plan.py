"""A plan as who makes it thinks of it, and as a packet on its way to the arm."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.control.config import Impedance
from wrenchflow.control.packet import MOST_WAYPOINTS, PACKET
from wrenchflow.errors import ControlError


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Where to be at which time, and how stiffly.

    Only the shapes are checked here. Whether the values can be followed is for the gate in the control process, which
    trusts nobody: a policy that puts out NaN must be counted and named there, not stop whoever sends it.

    Attributes:
        t_obs_ns: Stamp of the observation that it was made from.
        period_ns: Time until its maker's next plan is to be expected.
        t: Stamps of the waypoints [ns]. Shape (n,).
        poses: Target poses of the TCP in the base frame. Shape (n, 7).
        K_lin: Stiffness of translation, base axes [N/m]. Shape (n, 3, 3).
        K_rot: Stiffness of rotation, base axes [N.m/rad]. Shape (n, 3, 3).
        damping_ratio: Shape (n,).
        wrench: Feed-forward, exerted besides the spring, about the TCP, base axes [N, N.m]. Shape (n, 6).
        gripper: Width [m]; NaN where none is asked. Shape (n,).
        seq: Number of the plan among those of its maker.
        model: Number of its maker.
    """

    t_obs_ns: int
    period_ns: int
    t: Int64[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 7"]
    K_lin: Float[np.ndarray, "n 3 3"]
    K_rot: Float[np.ndarray, "n 3 3"]
    damping_ratio: Float[np.ndarray, " n"]
    wrench: Float[np.ndarray, "n 6"]
    gripper: Float[np.ndarray, " n"]
    seq: int = 0
    model: int = 0

    def __post_init__(self) -> None:
        shapes = {"t": (), "poses": (7,), "K_lin": (3, 3), "K_rot": (3, 3), "damping_ratio": (), "wrench": (6,)}
        for name, shape in {**shapes, "gripper": ()}.items():
            value, expected = getattr(self, name), (*self.t.shape[:1], *shape)
            if value.shape != expected:
                raise ControlError(f"{name} of a plan has shape {value.shape}, expected {expected}.")

    @classmethod
    def of_poses(
        cls,
        t: Int64[np.ndarray, " n"],
        poses: Float[np.ndarray, "n 7"],
        impedance: Impedance,
        *,
        t_obs_ns: int,
        period_ns: int,
        wrench: Float[np.ndarray, "n 6"] | None = None,
        gripper: Float[np.ndarray, " n"] | None = None,
        seq: int = 0,
        model: int = 0,
    ) -> "Plan":
        """A plan that is equally stiff all along, and where not given, without feed-forward and gripper."""
        n = len(t)
        return cls(
            t_obs_ns=t_obs_ns,
            period_ns=period_ns,
            t=t,
            poses=poses,
            K_lin=np.tile(np.eye(3) * impedance.translation_n_m, (n, 1, 1)),
            K_rot=np.tile(np.eye(3) * impedance.rotation_nm_rad, (n, 1, 1)),
            damping_ratio=np.full(n, impedance.damping_ratio),
            wrench=np.zeros((n, 6)) if wrench is None else wrench,
            gripper=np.full(n, np.nan) if gripper is None else gripper,
            seq=seq,
            model=model,
        )


def packet_of(plan: Plan, out: np.ndarray | None = None) -> np.ndarray:
    """The packet of a plan.

    Args:
        plan: What is planned. Of more than `MOST_WAYPOINTS` waypoints the packet says how many, which the gate refuses.
        out: Where to put it; a new one if None. Shape (1,), dtype `PACKET`.

    Returns:
        The packet. Shape (1,), dtype `PACKET`.
    """
    packet = np.zeros(1, PACKET) if out is None else out
    n, fit = len(plan.t), min(len(plan.t), MOST_WAYPOINTS)
    for name in ("seq", "model", "t_obs_ns", "period_ns"):
        packet[name] = getattr(plan, name)
    packet["count"] = n
    packet["x"][0, :fit], packet["quat_wxyz"][0, :fit] = plan.poses[:fit, :3], plan.poses[:fit, 3:]
    for name in ("t", "K_lin", "K_rot", "damping_ratio", "wrench", "gripper"):
        packet[name][0, :fit] = getattr(plan, name)[:fit]
    return packet
