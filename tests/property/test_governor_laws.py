"""Whatever is asked and whatever is seen: torque, its change and the reference keep their limits at every tick."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import TICK_NS, Controller
from wrenchflow.control.gate import is_stiffness
from wrenchflow.control.stiffness import clamp_stiffness
from wrenchflow.control.torque import cap_norm
from wrenchflow.errors import ControlError
from wrenchflow.rig import load_rig
from wrenchflow.spatial import IDENTITY_POSE, exp_so3

RIG = load_rig("panda_peg")
# Its readings stand still here, which a sensor with noise would not do.
RIG = replace(RIG, sensor=replace(RIG.sensor, noise_force_n=0.0, noise_torque_nm=0.0))
TORQUE_MAX, STEP_MAX = np.array(RIG.robot.torque_nm), np.array(RIG.robot.torque_rate_nm_s) * 1e-3
NOT_FINITE = st.sampled_from([np.nan, np.inf, -np.inf])

requests = st.one_of(
    st.just("keep"),
    st.tuples(st.just("jump"), st.floats(-1e3, 1e3), st.floats(-10.0, 10.0), st.integers(1, 50)),
    st.tuples(st.just("stiffness"), st.floats(0.0, 1e9), st.floats(0.0, 1e9)),
    st.tuples(st.just("spoil request"), st.sampled_from(["x_start", "x_stop", "R_start", "turn", "K_lin"]), NOT_FINITE),
    st.tuples(st.just("offset"), st.floats(-1.0, 1.0)),
    st.tuples(st.just("damping"), st.floats(0.0, 1e308)),
    st.tuples(st.just("wild request"), st.sampled_from(["x_start", "x_stop", "turn", "x_offset"]), st.floats()),
    st.tuples(st.just("mirror"), st.integers(0, 2)),
    st.just(("start again",)),
    st.tuples(st.just("move arm"), st.floats(-0.5, 0.5), st.floats(-4.0, 4.0)),
    st.tuples(st.just("fast joints"), st.floats(-100.0, 100.0)),
)
states = st.tuples(
    st.just("spoil state"), st.sampled_from(["q", "dq", "x", "R", "J", "M", "coriolis"]), st.integers(0, 48), NOT_FINITE
)


def started(seed: int, *, without=(), **config) -> Controller:
    """A controller at a random arm's state: any inertia, any Jacobian."""
    rng = np.random.default_rng(seed)
    controller = Controller(RIG, ControlConfig(**config), without=without)
    obs, root = controller.obs[0], rng.normal(size=(7, 7))
    middle = (np.array(RIG.robot.position_min_rad) + RIG.robot.position_max_rad) / 2.0
    obs["q"], obs["x"], obs["R"] = (
        middle + 0.1 * rng.normal(size=7),
        [0.5, 0.0, 0.3],
        Rotation.random(rng=rng).as_matrix(),
    )
    obs["J"], obs["M"], obs["coriolis"] = rng.normal(size=(6, 7)), root @ root.T + 0.1 * np.eye(7), rng.normal(size=7)
    controller.start(Impedance())
    controller.ask(controller.target_pose, controller.target_pose, ticks=1, impedance=Impedance())
    return controller


def ticked(controller: Controller) -> np.ndarray:
    """One tick of a clock that goes on."""
    controller.obs[0]["t_ns"] += TICK_NS
    return controller.tick()


def act(controller: Controller, action, rng: np.random.Generator) -> None:
    obs, req, kind = controller.obs[0], controller.req[0], action[0]
    if kind == "jump":
        stop = np.concatenate([rng.normal(size=3) * action[1], IDENTITY_POSE[3:]])
        stop[3:] = Rotation.from_rotvec(rng.normal(size=3) * action[2]).as_quat(scalar_first=True)
        controller.ask(controller.target_pose, stop, ticks=action[3], impedance=Impedance())
    elif kind == "stiffness":
        req["K_lin"], req["K_rot"] = np.eye(3) * action[1], np.eye(3) * action[2]
    elif kind == "spoil request":
        req[action[1]].flat[int(rng.integers(3))] = action[2]
    elif kind == "offset":
        req["x_offset"] = action[1]
    elif kind == "damping":
        req["damping_ratio"] = action[1]
    elif kind == "wild request":
        req[action[1]] = action[2]
    elif kind == "mirror":
        req["R_start"][:, action[1]] *= -1.0
    elif kind == "start again":
        with suppress(ControlError):  # What is stopped, or cannot be read, does not start.
            controller.start(Impedance())
    elif kind == "move arm":
        obs["x"] += rng.normal(size=3) * action[1]
        obs["R"] = exp_so3(rng.normal(size=3) * action[2]) @ obs["R"]
    elif kind == "fast joints":
        obs["dq"] = rng.normal(size=7) * action[1]
    elif kind == "spoil state":
        obs[action[1]].flat[action[2] % obs[action[1]].size] = action[3]


def assert_within_limits(controller: Controller, before: np.ndarray) -> None:
    tau = controller.ctl[0]["tau"]
    assert np.isfinite(tau).all()
    assert (np.abs(tau) <= TORQUE_MAX).all()
    assert (np.abs(tau - before) <= STEP_MAX * (1.0 + 1e-12)).all()


def assert_leashed(controller: Controller, config: ControlConfig) -> None:
    ctl, obs = controller.ctl[0], controller.obs[0]
    K_lin, K_rot = np.abs(ctl["K_lin"]).sum(1), np.abs(ctl["K_rot"]).sum(1).max()
    assert (K_lin * np.abs(ctl["x_d"] - obs["x"]) <= config.force_max_n * (1.0 + 1e-9)).all()
    angle = (Rotation.from_matrix(ctl["R_d"]) * Rotation.from_matrix(obs["R"]).inv()).magnitude()
    assert K_rot * min(angle, np.pi - 1e-9) <= config.moment_max_nm * (1.0 + 1e-6) + 1e-6 * K_rot
    np.testing.assert_allclose(ctl["R_d"] @ ctl["R_d"].T, np.eye(3), atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), actions=st.lists(requests, max_size=30))
def test_no_request_moves_torque_or_reference_past_its_limits(seed, actions):
    config, rng = ControlConfig(ramp_s=0.01), np.random.default_rng(seed)
    controller = started(seed, ramp_s=0.01)
    for action in actions:
        act(controller, action, rng)
        for _ in range(4):
            before = controller.ctl[0]["tau"].copy()
            ticked(controller)
            assert_within_limits(controller, before)
            assert controller.cause not in ("gate-state", "gate-torque"), "a request latched the arm"
            if controller.mode != "latched":  # Then the spring is let go of, and its reference forgotten.
                assert_leashed(controller, config)
            assert np.isfinite(controller.target_pose).all()
            assert np.linalg.det(controller.ctl[0]["R_target"]) > 0.0


@given(
    seed=st.integers(0, 2**32 - 1),
    before=st.lists(requests, max_size=8),
    spoiled=states,
    after=st.lists(st.one_of(requests, states), max_size=8),
)
def test_a_state_that_is_not_finite_latches_and_torque_goes_to_a_brake_at_the_rate_limit(seed, before, spoiled, after):
    # What else might stop this arm, which jumps about, would stop it before.
    rng = np.random.default_rng(seed)
    controller = started(seed, ramp_s=0.01, without=("joint-speed", "joint-limit", "observer"))
    healthy = controller.obs.copy()
    for action in before:
        act(controller, action, rng)
        for _ in range(10):
            ticked(controller)
    act(controller, spoiled, rng)
    step, limit = controller.ctl[0]["tau_step_max"], controller.ctl[0]["tau_max"]
    last = controller.ctl[0]["tau"].copy()
    for k in range(200):
        if k < len(after):
            act(controller, after[k], rng)
        if k == 20:  # A state that becomes finite again does not unlatch.
            controller.obs[:] = healthy
        obs = controller.obs[0]
        is_finite = all(np.isfinite(obs[name]).all() for name in ("q", "dq", "x", "R", "J", "M", "coriolis"))
        wanted = np.clip(-ControlConfig().brake_nm_s_rad * obs["dq"], -limit, limit) if is_finite else np.zeros(7)
        tau = ticked(controller)
        np.testing.assert_allclose(tau, last + np.clip(wanted - last, -step, step), atol=1e-12)
        last = tau.copy()
        assert (controller.mode, controller.cause) == ("latched", "gate-state")


@pytest.mark.parametrize(
    "name", ["x_start", "x_stop", "R_start", "turn", "K_lin", "K_rot", "damping_ratio", "x_offset"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_request_that_is_not_finite_is_counted_and_not_followed(name, value):
    controller, other = started(0), started(0)
    for k in range(30):
        if k == 10:
            kept = controller.req.copy()
            spoiled = np.array(controller.req[0][name])
            spoiled.flat[-1] = value
            controller.req[0][name] = spoiled
        if k == 20:
            controller.req[:] = kept
        assert ticked(controller).tobytes() == ticked(other).tobytes()
        assert controller.target_pose.tobytes() == other.target_pose.tobytes()
    assert controller.ctl[0]["rejected"] == 1  # One request, however long it is not followed.
    assert controller.interventions["gate-request"] == 10
    assert controller.mode == "run"


def test_a_rotation_that_is_none_is_not_followed_either():
    controller = started(0)
    controller.req[0]["R_start"] *= 1.001
    ticked(controller)
    assert controller.ctl[0]["rejected"] == 1


def test_a_law_that_gives_no_finite_torque_latches():
    controller = started(0, without=("gate-state",))  # Which would keep such a state out.
    controller.obs[0]["J"] *= 1e200
    ticked(controller)
    assert (controller.mode, controller.cause) == ("latched", "gate-torque")
    np.testing.assert_array_equal(controller.ctl[0]["tau"], 0.0)  # What cannot be read is not braked.
    controller.obs[0]["J"] *= 1e-200
    controller.obs[0]["dq"] = 1.0
    controller.obs[0]["q"] += 0.001  # It does turn.
    ticked(controller)
    assert (controller.mode, controller.cause) == ("latched", "gate-torque")
    np.testing.assert_array_equal(controller.ctl[0]["tau"], -controller.ctl[0]["tau_step_max"])  # It brakes.


@given(seed=st.integers(0, 2**32 - 1), soft=st.floats(0.0, 49.0), stiff=st.floats(1501.0, 1e9))
def test_stiffness_stays_in_its_range_along_its_own_axes(seed, soft, stiff):
    axes = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    asked, out, again = axes @ np.diag([soft, 300.0, stiff]) @ axes.T, np.empty((3, 3)), np.empty((3, 3))
    assert clamp_stiffness(asked, 50.0, 1500.0, out)
    np.testing.assert_allclose(out, axes @ np.diag([50.0, 300.0, 1500.0]) @ axes.T, atol=1e-6 * stiff)
    np.testing.assert_allclose(np.linalg.eigvalsh(out)[[0, 2]], [50.0, 1500.0], rtol=1e-9)
    clamp_stiffness(out, 50.0 * (1.0 - 1e-9), 1500.0 * (1.0 + 1e-9), again)
    np.testing.assert_allclose(again, out, rtol=1e-12, atol=1e-9)
    assert clamp_stiffness(np.diag([soft, 300.0, stiff]), 50.0, 1500.0, out)
    np.testing.assert_array_equal(out, np.diag([50.0, 300.0, 1500.0]))
    assert not clamp_stiffness(out, 50.0, 1500.0, again)
    np.testing.assert_array_equal(out, again)


@given(seed=st.integers(0, 2**32 - 1), far=st.floats(0.01, 2.0), turn=st.floats(0.1, 3.0))
def test_the_voluntary_step_of_the_reference_keeps_its_speed(seed, far, turn):
    rng, controller = np.random.default_rng(seed), started(seed)
    x, R = controller.ctl[0]["x_d"].copy(), Rotation.from_matrix(controller.ctl[0]["R_d"])
    act(controller, ("jump", far, turn, 1), rng)
    for _ in range(50):
        ticked(controller)
        x_d, R_d = controller.ctl[0]["x_d"], Rotation.from_matrix(controller.ctl[0]["R_d"])
        assert np.linalg.norm(x_d - x) <= 0.25e-3 * (1.0 + 1e-9)
        assert (R_d * R.inv()).magnitude() <= 1e-3 * (1.0 + 1e-6)
        x, R = x_d.copy(), R_d


@given(seed=st.integers(0, 2**32 - 1), jump=st.floats(0.0, 2.0))
def test_the_reference_never_leaves_the_workspace_but_for_an_arm_that_is_outside(seed, jump):
    rng, controller = np.random.default_rng(seed), started(seed)
    act(controller, ("jump", jump, 0.0, 1), rng)
    for _ in range(400):
        controller.obs[0]["x"] = controller.ctl[0]["x_d"]  # An arm that follows at once.
        ticked(controller)
    x_d = controller.ctl[0]["x_d"]
    assert (x_d >= np.array(RIG.workspace.min_m) - 1e-12).all()
    assert (x_d <= np.array(RIG.workspace.max_m) + 1e-12).all()


@given(seed=st.integers(0, 2**32 - 1))
def test_start_is_without_a_bump(seed):
    controller = started(seed)
    controller.obs[0]["coriolis"] = 0.0
    ctl, obs = controller.ctl[0], controller.obs[0]
    np.testing.assert_array_equal(ctl["x_d"], obs["x"])
    np.testing.assert_array_equal(ctl["R_d"], obs["R"])
    np.testing.assert_allclose(ticked(controller), 0.0, atol=1e-9)
    for _ in range(20):
        np.testing.assert_allclose(ticked(controller), 0.0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), cap=st.floats(0.1, 10.0))
def test_a_limited_value_limited_twice_is_itself(seed, cap):
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=6) * 10.0
    once = vector.copy()
    cap_norm(once, 3, cap)
    assert np.linalg.norm(once[3:]) <= cap * (1.0 + 1e-12)
    np.testing.assert_array_equal(once[:3], vector[:3])
    np.testing.assert_allclose(np.cross(once[3:], vector[3:]), 0.0, atol=1e-9)
    twice = once.copy()
    cap_norm(twice, 3, cap)
    np.testing.assert_allclose(twice, once, rtol=1e-12)


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9),
    st.lists(st.floats(0.0, 1500.0), min_size=3, max_size=3),
)
def test_the_gate_knows_a_spring_from_what_pushes_the_arm_away(entries: list[float], gains: list[float]):
    axes = np.linalg.qr(np.array(entries).reshape(3, 3) + 2.0 * np.eye(3))[0]
    spring = axes @ np.diag(gains) @ axes.T
    spring = (spring + spring.T) / 2.0
    assert is_stiffness(spring)
    pushing = axes @ np.diag([gains[0] + 1.0, gains[1] + 1.0, -1.0 - 0.1 * max(gains)]) @ axes.T
    assert not is_stiffness((pushing + pushing.T) / 2.0)
    twisted = spring + 0.1 * (1.0 + max(gains)) * np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])
    assert not is_stiffness(twisted)


@pytest.mark.parametrize(("field", "value"), [("damping_ratio", -0.1), ("K_lin", -np.eye(3)), ("K_rot", -np.eye(3))])
def test_a_request_that_would_drive_the_arm_is_counted_and_not_followed(field: str, value: object):
    controller = Controller(RIG, ControlConfig(ramp_s=0.0))
    obs = controller.obs[0]
    obs["q"] = (np.array(RIG.robot.position_min_rad) + RIG.robot.position_max_rad) / 2.0
    obs["R"], obs["M"], obs["J"] = np.eye(3), np.eye(7), np.eye(6, 7)
    controller.start(Impedance())
    controller.ask(controller.target_pose, controller.target_pose, ticks=1, impedance=Impedance())
    ticked(controller)
    assert controller.mode == "run"
    controller.req[0][field] = value
    ticked(controller)
    assert controller.ctl[0]["rejected"] == 1
    assert controller.mode == "run"
