"""A plan: its shapes are held, its values are for the gate, and its packet says what it says."""

import numpy as np
import pytest

from wrenchflow.control.config import Impedance
from wrenchflow.control.packet import MOST_WAYPOINTS, PACKET
from wrenchflow.control.plan import Plan, packet_of
from wrenchflow.errors import ControlError

POSES = np.tile([0.5, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0], (3, 1))
T = np.array([50, 100, 150]) * 1_000_000


def plan(n: int = 3, **change) -> Plan:
    poses, t = np.tile(POSES[:1], (n, 1)), 50_000_000 * np.arange(1, n + 1)
    return Plan.of_poses(t, poses, Impedance(), t_obs_ns=7, period_ns=50_000_000, **change)


def test_a_plan_of_poses_is_equally_stiff_all_along_and_asks_for_nothing_else():
    made = Plan.of_poses(T, POSES, Impedance(translation_n_m=300.0, damping_ratio=0.7), t_obs_ns=7, period_ns=9, seq=4)
    assert (made.t_obs_ns, made.period_ns, made.seq, made.model) == (7, 9, 4, 0)
    np.testing.assert_array_equal(made.K_lin, np.stack([np.eye(3) * 300.0] * 3))
    np.testing.assert_array_equal(made.K_rot, np.stack([np.eye(3) * 25.0] * 3))
    np.testing.assert_array_equal(made.damping_ratio, [0.7] * 3)
    np.testing.assert_array_equal(made.wrench, np.zeros((3, 6)))
    assert np.isnan(made.gripper).all()


def test_a_packet_says_what_the_plan_says():
    rng = np.random.default_rng(0)
    made = Plan(
        t_obs_ns=3,
        period_ns=50_000_000,
        t=T,
        poses=rng.normal(size=(3, 7)),
        K_lin=rng.normal(size=(3, 3, 3)),
        K_rot=rng.normal(size=(3, 3, 3)),
        damping_ratio=rng.normal(size=3),
        wrench=rng.normal(size=(3, 6)),
        gripper=rng.normal(size=3),
        seq=5,
        model=6,
    )
    packet = packet_of(made)
    assert packet.dtype == PACKET
    assert packet.shape == (1,)
    assert packet[["seq", "model", "t_obs_ns", "period_ns", "count"]].item() == (5, 6, 3, 50_000_000, 3)
    np.testing.assert_array_equal(np.hstack([packet["x"][0, :3], packet["quat_wxyz"][0, :3]]), made.poses)
    for name in ("t", "K_lin", "K_rot", "damping_ratio", "wrench", "gripper"):
        np.testing.assert_array_equal(packet[name][0, :3], getattr(made, name))


def test_a_packet_in_place_is_the_same_as_a_new_one():
    room = packet_of(plan(2, seq=1))
    assert packet_of(plan(3, seq=2), room) is room
    assert room.tobytes() == packet_of(plan(3, seq=2)).tobytes()


@pytest.mark.parametrize("n", [0, MOST_WAYPOINTS, MOST_WAYPOINTS + 1, 1000])
def test_a_packet_says_how_many_waypoints_there_were_even_if_it_cannot_hold_them(n: int):
    assert packet_of(plan(n))["count"][0] == n


def test_a_mad_plan_can_be_made_and_sent():
    packet = packet_of(plan(2, wrench=np.full((2, 6), np.nan), gripper=np.array([np.inf, -1.0])))
    assert np.isnan(packet["wrench"][0, :2]).all()
    mad = Plan.of_poses(T[::-1].copy(), POSES * np.nan, Impedance(), t_obs_ns=-1, period_ns=-5)
    assert packet_of(mad)["period_ns"][0] == -5


@pytest.mark.parametrize(
    ("name", "value"),
    [("poses", np.zeros((2, 7))), ("wrench", np.zeros((3, 5))), ("gripper", np.zeros(4)), ("t", np.zeros((3, 1), int))],
)
def test_shapes_that_do_not_fit_are_refused(name: str, value: np.ndarray):
    import jaxtyping

    good = {field: getattr(plan(), field) for field in Plan.__dataclass_fields__}
    jaxtyping.config.update("jaxtyping_disable", True)  # As it is when no tests run.
    try:
        with pytest.raises(ControlError, match=r"of a plan has shape \(.*\), expected \("):
            Plan(**{**good, name: value})
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)
