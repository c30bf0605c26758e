"""Robots, sensors and callers that are worse than the adversaries of the invariants: what must not come of it."""

import jaxtyping
import numpy as np
import pytest

from safety.adversaries import duty, moved, retarget
from safety.arena import Arena
from safety.checks import check
from safety.limits import check_contact
from safety.packets import now_ns, plan_of
from wrenchflow.control.config import Impedance
from wrenchflow.control.packet import PACKET
from wrenchflow.control.plan import packet_of
from wrenchflow.errors import ControlError


@pytest.fixture
def without_shape_checks():
    """Wrong shapes are what these tests are about."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def unsound_request(arena: Arena) -> None:
    """Ask for a target that is none, and that is not to expire."""
    pose = arena.base_target.copy()
    pose[0] = np.nan
    retarget(arena, pose, 50)


def test_an_unsound_request_does_not_switch_off_the_watch_for_silence():
    arena = Arena("free", 0)
    retarget(arena, arena.base_target, 50, every_s=0.05)
    arena.run(50)
    unsound_request(arena)
    arena.run(200)
    assert (arena.controller.mode, arena.controller.cause) == ("hold", "silence")


def test_an_unsound_request_does_not_take_the_plan_away():
    arena = Arena("free", 0)
    poses = np.tile(moved(arena, [0.01, 0.0, 0.0]), (6, 1))
    assert arena.controller.accept(packet_of(plan_of(arena, poses, Impedance())), now_ns(arena)) == "accepted"
    arena.run(50)
    unsound_request(arena)
    arena.run(500)
    assert arena.controller.mode == "hold"


def test_a_sensor_that_dies_is_missed_even_if_it_never_had_noise():
    arena = Arena("wall", 0, noisy=False)
    arena.play(duty(arena, arena.rng), ticks=500)
    arena.tampers["sensor"] = lambda obs: obs["wrench"].fill(np.nan)
    arena.play(duty(arena, arena.rng), ticks=100)
    assert arena.controller.cause == "sensor"


@pytest.mark.parametrize("force_n", [1e4, 1e100, 1e308])
def test_after_one_reading_that_no_sensor_gives_an_operator_can_go_on(force_n):
    arena = Arena("free", 0)
    arena.play(duty(arena, arena.rng), ticks=300)
    arena.tampers["sensor"] = lambda obs: obs["wrench"].fill(force_n)
    arena.run(1)
    arena.tampers.clear()
    arena.run(400)
    if arena.controller.mode == "latched":
        arena.controller.reset()
    arena.play(duty(arena, arena.rng), ticks=300)
    assert arena.controller.mode == "run"
    assert np.abs(arena.controller.ctl[0]["wrench"][:3]).max() < 5.0


@pytest.mark.parametrize("name", ["tau_external", "tau"])
def test_a_torque_that_was_not_measured_spoils_no_sum(name):
    arena = Arena("free", 0)
    arena.play(duty(arena, arena.rng), ticks=300)
    arena.tampers["torque"] = lambda obs: obs[name].fill(np.nan)
    arena.run(1)
    arena.tampers.clear()
    arena.run(10)
    for sum_j in ("damped", "fed", "posed", "saturated", "exerted", "filled", "kinetic"):
        assert np.isfinite(arena.controller.ctl[0][sum_j]), sum_j


@pytest.mark.parametrize("name", ["q", "dq", "x", "R", "J", "M", "coriolis"])
def test_an_arm_that_cannot_be_read_is_not_reset(name):
    arena = Arena("free", 0)
    arena.play(duty(arena, arena.rng), ticks=300)
    arena.controller.stop()
    arena.run(50)
    arena.controller.obs[0][name].flat[0] = np.nan
    with pytest.raises(ControlError):
        arena.controller.reset()
    arena.run(1)
    arena.controller.reset()
    arena.play(duty(arena, arena.rng), ticks=50)
    assert arena.controller.mode == "run"


def test_a_place_that_no_arm_is_at_leaves_tank_and_budget_finite():
    arena = Arena("free", 0)
    arena.play(duty(arena, arena.rng), ticks=300)
    arena.tampers["place"] = lambda obs: obs["x"].fill(1e160)
    arena.run(1)
    arena.tampers.clear()
    arena.run(20)
    for name in ("tank", "spring", "budget"):
        assert np.isfinite(arena.controller.ctl[0][name]), name


def test_a_latched_arm_is_not_driven_by_joints_that_seem_to_turn():
    arena = Arena("free", 0, noisy=False)
    arena.play(duty(arena, arena.rng), ticks=300)
    arena.tampers["speed"] = lambda obs: obs["dq"].fill(1.5)
    arena.controller.stop()
    start = arena.log.count
    arena.run(500)
    assert arena.log.trace.work[start:].sum() < 0.1  # [J]


def test_where_contact_is_expected_the_arm_is_slow_even_if_it_is_pushed_by_feed_forward():
    arena = Arena("wall", 0, noisy=False)
    retarget(arena, moved(arena, [0.0, 0.0, -0.018]), 300)
    arena.run(1000)
    arena.controller.req[0]["wrench"][:2] = -20.0, 15.0
    retarget(arena, moved(arena, [0.0, 0.0, -0.018]), 1)
    arena.run(300)
    ctl = arena.controller.ctl[0]
    in_zone = ((arena.log.trace.truth["x"] > ctl["zone_min"]) & (arena.log.trace.truth["x"] < ctl["zone_max"])).all(1)
    speed_m_s = np.sqrt((arena.log.trace.twist[:, :3] ** 2).sum(1))[in_zone & (np.arange(len(in_zone)) > 1100)]
    assert speed_m_s.max() < 1.1 * arena.config.arm_speed_share * arena.config.zone_speed_m_s


def test_a_peg_that_turns_in_its_hole_hits_the_wall_no_harder_than_one_that_comes_down():
    arena = Arena("hole", 0, noisy=False)
    retarget(arena, arena.base_target, 50)
    arena.run(600)
    for turn_rad in (0.25, -0.25, 0.25):
        retarget(arena, moved(arena, np.zeros(3), np.array([0.0, turn_rad, 0.0])), 1)
        arena.run(700)
    findings = {each.name: each for each in check_contact(arena.log.trace, arena.config)}
    assert findings["contact impact [150/s m v]"].holds, str(findings["contact impact [150/s m v]"])


@pytest.mark.parametrize("every_s", [float("nan"), -1.0, 0.0])
def test_a_promise_that_is_none_is_refused_with_its_value(every_s):
    arena = Arena("free", 0)
    with pytest.raises(ControlError, match="every_s"):
        retarget(arena, arena.base_target, 50, every_s=every_s)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("R", lambda R: R * 2.0),
        ("R", lambda R: R * -1.0),
        ("R", lambda R: R[[1, 0, 2]]),
        ("M", lambda M: M * 1e300),
        ("M", lambda M: M * -1.0),
        ("M", lambda M: M * 0.0),
        ("J", lambda J: J * 1e6),
        ("q", lambda q: q + np.eye(7)[3] * 3.0),
        ("dq", lambda dq: dq + 1e6),
        ("coriolis", lambda c: c + 1e6),
    ],
)
def test_an_arm_that_cannot_be_so_is_latched_and_comes_to_rest(name, change):
    arena = Arena("free", 0)
    retarget(arena, moved(arena, [0.05, 0.0, 0.0]), 300)
    arena.run(200)

    def tamper(obs):
        obs[name] = change(obs[name].copy())

    arena.tampers["state"] = tamper
    arena.run(1)
    arena.tampers.clear()
    arena.run(400)
    assert (arena.controller.mode, arena.controller.cause) == ("latched", "gate-state")
    assert [str(finding) for finding in check(arena, arena.log.trace) if not finding.holds] == []
    assert np.abs(arena.log.trace.truth["dq"][-1]).max() < 0.02


@pytest.mark.parametrize(
    "wrong",
    [
        {"wrench": np.zeros(5)},
        {"every_s": 1e300},
        {"every_s": float("nan")},
        {"ticks": 2**70},
        {"ticks": 1.5},
        {"ticks": 0},
        {"impedance": None},
        {"stop": np.zeros(6)},
        {"disturbance_m": np.zeros(2)},
    ],
    ids=str,
)
def test_what_is_no_request_is_told_and_nothing_of_it_is_asked(wrong, without_shape_checks):
    arena = Arena("free", 0)
    retarget(arena, arena.base_target, 50)
    arena.run(100)
    before = arena.controller.req.tobytes(), arena.controller.ctl["is_asked"][0]
    far = moved(arena, [0.1, 0.0, 0.0])
    with pytest.raises(ControlError):
        arena.controller.ask(**{"start": far, "stop": far, "ticks": 1, "impedance": Impedance(), **wrong})
    assert (arena.controller.req.tobytes(), arena.controller.ctl["is_asked"][0]) == before


def test_a_quaternion_that_is_not_unit_is_counted_and_not_followed():
    arena = Arena("free", 0)
    retarget(arena, arena.base_target, 50)
    arena.run(100)
    target = arena.controller.target_pose
    for length in (0.0, 0.99, 5.0):
        far = moved(arena, [0.1, 0.0, 0.0])
        far[3:] *= length
        arena.controller.ask(far, far, ticks=1, impedance=Impedance())
        arena.run(20)
        np.testing.assert_array_equal(arena.controller.target_pose, target)
    assert arena.controller.refusals == {"segment": 3}


@pytest.mark.parametrize("packet", [None, np.zeros(1), np.zeros(2, PACKET), np.zeros((), PACKET)], ids="0123")
def test_what_is_no_packet_is_told(packet, without_shape_checks):
    arena = Arena("free", 0)
    with pytest.raises(ControlError, match="one record of dtype PACKET"):
        arena.controller.accept(packet, now_ns(arena))


@pytest.mark.parametrize(
    ("name", "value"), [("q", np.nan), ("x", np.nan), ("dq", np.nan), ("x", 1e300), ("R", 7.0), ("M", 0.0)]
)
def test_an_arm_that_cannot_be_read_does_not_start_and_nothing_that_is_no_number_leaves(name, value):
    arena = Arena("free", 0)
    controller, sound = arena.controller, arena.controller.obs.copy()
    controller.obs[name] = value
    with pytest.raises(ControlError, match="cannot begin"):
        controller.start(Impedance())
    controller.obs[:] = sound
    controller.ctl["q_last"] = np.nan  # Even if it had begun so.
    for _ in range(5):
        assert np.isfinite(controller.tick()).all()


def test_a_stop_is_ended_by_reset_alone():
    arena = Arena("free", 0)
    arena.controller.stop()
    for _ in range(2):  # Asked for, then in force.
        with pytest.raises(ControlError, match="reset"):
            arena.controller.start(Impedance())
        arena.run(50)
    packet = packet_of(plan_of(arena, np.tile(arena.base_target, (3, 1)), Impedance()))
    assert arena.controller.accept(packet, now_ns(arena)) == "stopped"
    arena.controller.reset()
    assert arena.controller.mode == "hold"


def test_nobody_who_asked_for_nothing_is_refused():
    arena = Arena("free", 0)
    arena.controller.stop()
    arena.run(100)
    assert arena.controller.refusals == {}
    assert "gate-request" not in arena.controller.interventions


@pytest.mark.parametrize("axes", [[0], [1], [2], [0, 1, 2], [3, 4, 5]], ids=str)
def test_a_sensor_with_some_channels_frozen_is_missed(axes):
    arena = Arena("wall", 0)
    arena.play(duty(arena, arena.rng), ticks=500)
    frozen = arena.controller.obs[0]["wrench"].copy()

    def freeze(obs):
        obs["wrench"][axes] = frozen[axes]

    arena.tampers["sensor"] = freeze
    arena.play(duty(arena, arena.rng), ticks=50)
    assert arena.controller.cause == "sensor"


def test_a_moment_leads_to_a_retreat_and_a_hold_and_to_a_stop_only_if_it_stays():
    ends = {}
    for stays in (False, True):
        arena = Arena("free", 0)
        retarget(arena, arena.base_target, 50)
        arena.run(500)
        arena.tampers["moment"] = lambda obs: np.add(obs["wrench"], [0, 0, 0, 0, 0, 9.0], out=obs["wrench"])
        modes = []
        for _ in range(1200):
            arena.run(1)
            if arena.controller.mode not in modes:
                modes.append(arena.controller.mode)
            if arena.controller.mode == "retreat" and not stays:
                arena.tampers.clear()
            if arena.controller.mode == "hold":
                break
        ends[stays] = modes
    assert ends == {False: ["run", "retreat", "hold"], True: ["run", "retreat", "soft-stop"]}
