"""Scripts that send plans: a policy that plans at 20 Hz, and one that sends what nobody should."""

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from safety.arena import Arena
from wrenchflow.control.config import Impedance
from wrenchflow.control.plan import Plan, packet_of

PERIOD_NS, STEP_NS = 50_000_000, 50_000_000
WAYPOINTS = 8


def now_ns(arena: Arena) -> int:
    """The stamp that the controller saw last."""
    return int(arena.controller.obs[0]["t_ns"])


def plan_of(arena: Arena, poses: np.ndarray, impedance: Impedance, *, start_ns: int | None = None) -> Plan:
    """A plan from now on, or from another time.

    Args:
        arena: Whose clock it is.
        poses: Shape (n, 7).
        impedance: How stiffly.
        start_ns: When its observation was made.
    """
    t_obs_ns = now_ns(arena) if start_ns is None else start_ns
    t = t_obs_ns + STEP_NS * np.arange(1, len(poses) + 1)
    return Plan.of_poses(t, poses, impedance, t_obs_ns=t_obs_ns, period_ns=PERIOD_NS)


def wandering_plan(arena: Arena, rng: Generator) -> Plan:
    """Waypoints about the place's target, and gains that go up and down along them."""
    poses = np.tile(arena.base_target, (WAYPOINTS, 1))
    poses[:, :3] += rng.normal(size=3) * rng.choice([0.002, 0.05]) + rng.normal(size=(WAYPOINTS, 3)) * 0.002
    # A pose outside the workspace is refused, and this one is meant.
    poses[:, :3] = np.clip(poses[:, :3], arena.rig.workspace.min_m, arena.rig.workspace.max_m)
    plan = plan_of(arena, poses, Impedance())
    gains = rng.uniform(0.1, 3.0, WAYPOINTS)
    return replace(
        plan,
        K_lin=plan.K_lin * gains[:, None, None],
        K_rot=plan.K_rot * gains[:, None, None],
        damping_ratio=rng.uniform(0.1, 2.5, WAYPOINTS),
        wrench=rng.normal(size=(WAYPOINTS, 6)) * [5.0, 5.0, 5.0, 0.3, 0.3, 0.3] * rng.choice([0.0, 1.0, 10.0]),
    )


def plans(arena: Arena, rng: Generator):
    """A policy that plans 20 times a second, sometimes late, and now and then not at all."""
    while True:
        arena.controller.accept(packet_of(wandering_plan(arena, rng)), now_ns(arena))
        yield int(rng.choice([50, 50, 50, 50, 90, 300, 700]))


def bad_plans(arena: Arena, rng: Generator):
    """The same, and between its plans those that are replayed, reordered, empty, past, future, or no plans at all."""
    last = packet_of(wandering_plan(arena, rng))
    while True:
        packet = packet_of(wandering_plan(arena, rng))
        bad, kind = packet.copy(), rng.integers(9)
        if kind == 0:
            bad = last
        elif kind == 1:
            bad["t_obs_ns"] = last["t_obs_ns"] - 1
        elif kind == 2:
            bad["count"] = rng.choice([-1, 0, 65, 1 << 40])
        elif kind == 3:
            bad["t_obs_ns"] += rng.choice([10**6, 10**12, 1 << 62])
        elif kind == 4:
            bad["t_obs_ns"] -= rng.choice([2 * 10**9, 1 << 62])
        elif kind == 5:
            name = rng.choice(["x", "quat_wxyz", "K_lin", "K_rot", "damping_ratio", "wrench"])
            bad[name].flat[rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
        elif kind == 6:
            bad["t"][0, :WAYPOINTS] = rng.permutation(bad["t"][0, :WAYPOINTS]) * rng.choice([1, -1])
        elif kind == 7:
            bad["quat_wxyz"][0, :WAYPOINTS] *= rng.choice([-1.0, 0.0, 0.9, 1.0005])
        else:
            bad = np.frombuffer(rng.bytes(packet.nbytes), packet.dtype).copy()
        arena.controller.accept(bad, now_ns(arena))
        yield int(rng.integers(1, 30))
        if rng.random() < 0.7:
            arena.controller.accept(packet, now_ns(arena))
            last = packet
        yield int(rng.integers(10, 60))
