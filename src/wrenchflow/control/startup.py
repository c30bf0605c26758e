"""Checks of an arm, its sensor and its tool before a session: what control rests on is tried, gently, and not believed.

The arm holds still, turns its tool by a little about two axes, and leans against its own spring; that takes fifteen
seconds. What is found is a value that can be recorded; what is wrong is an error that says what, got and expected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from wrenchflow.control.config import Impedance
from wrenchflow.control.controller import TICK_S, Controller
from wrenchflow.control.felt import GRAVITY_M_S2
from wrenchflow.control.records import OBS
from wrenchflow.control.robot import Robot
from wrenchflow.control.trial import Seen, Trial
from wrenchflow.errors import StartupError
from wrenchflow.rig import Rig
from wrenchflow.signals import WRENCH
from wrenchflow.spatial import compose, exp_so3, inverse, log_so3, make_pose, rotation_of

_NOISE_FLOOR = np.repeat([0.02, 0.002], 3)  # What a reading without noise may spread by [N, N.m].


@dataclass(frozen=True, kw_only=True)
class StartupConfig:
    """How the checks go about it, and what they accept.

    Attributes:
        impedance: How stiffly the arm is held meanwhile.
        rest_s: How long the sensor is listened to at rest [s].
        speed_max_rad_s: Any joint that is faster is not at rest [rad/s].
        joint_margin_rad: How far every joint must be from its ends [rad].
        contact_torque_nm: More external torque on a joint is a contact [N.m]: twice what a good model is off by.
        contact_force_n: More force than the tool's weight explains is a contact [N]; a sensor's bias is less.
        noise_share_min: Less of the noise that the rig states is a sensor that is dead or frozen.
        noise_share_max: More of it is a sensor that is disturbed.
        range_share_max: A reading at rest beyond this share of the range leaves no room to measure in.
        turn_rad: By how much the tool is turned [rad].
        turn_s: How long that takes, where the arm may turn so fast [s].
        listen_s: How long is measured once the arm is still [s].
        mass_tolerance_kg: How far the mass may be off [kg], and
        mass_tolerance_share: as a share of the rig's; the larger of both counts.
        kinematics_tolerance_m: How far the pose may be from what the Jacobian says [m].
        kinematics_tolerance_rad: The same for the orientation [rad].
        push_n: How hard the arm leans against its spring [N]; less where that is over half of its force limit, or
        push_max_m: would move it further than this [m].
        push_s: For how long before it may come to rest [s].
        push_tolerance: How far the tool may come to lie from F / K, as a share of it.
        strength_tolerance: How far the speed that torque gives may be from what the inertia says, as a share of it.
    """

    impedance: Impedance = field(default_factory=Impedance)
    rest_s: float = 0.5
    speed_max_rad_s: float = 0.02
    joint_margin_rad: float = 0.2
    contact_torque_nm: float = 2.0
    contact_force_n: float = 5.0
    noise_share_min: float = 0.2
    noise_share_max: float = 3.0
    range_share_max: float = 0.9
    turn_rad: float = 0.15
    turn_s: float = 0.6
    listen_s: float = 0.4
    mass_tolerance_kg: float = 0.05
    mass_tolerance_share: float = 0.15
    kinematics_tolerance_m: float = 0.001
    kinematics_tolerance_rad: float = 0.005
    push_n: float = 5.0
    push_max_m: float = 0.01
    push_s: float = 0.3
    push_tolerance: float = 0.2
    strength_tolerance: float = 0.2


@dataclass(frozen=True, kw_only=True)
class StartupReport:
    """What the checks found, of an arm that passed them.

    Attributes:
        joint_margin_rad: From the joint that is nearest to one of its ends [rad].
        noise: Standard deviation of a reading at rest [N, N.m].
        external_torque_nm: Largest external torque on a joint [N.m].
        contact_force_n: Largest change of force that the tool's weight does not explain, low-passed [N].
        unloaded_n: Force that is left at rest without the tool's weight: the sensor's bias, or a contact [N].
        mass_kg: Of what hangs below the sensor.
        kinematics_m: Largest distance between the pose and what the Jacobian says of it [m].
        kinematics_rad: The same for the orientation [rad].
        compliance: Way of the tool under a push, over F / K, along each axis of the base.
        strength: Speed that the arm gains from its torque, over what its inertia says.
    """

    joint_margin_rad: float
    noise: tuple[float, ...]
    external_torque_nm: float
    contact_force_n: float
    unloaded_n: float
    mass_kg: float
    kinematics_m: float
    kinematics_rad: float
    compliance: tuple[float, ...]
    strength: float


def check_startup(robot: Robot, controller: Controller, rig: Rig, config: StartupConfig | None = None) -> StartupReport:
    """Check an arm that nothing has been put on top of yet; afterwards it is back where it was.

    Args:
        robot: The arm, at rest, with room of a hand's breadth around its tool. After an error it is not commanded any
            more.
        controller: Its controller, which is begun here, and has to be begun again by whoever goes on.
        rig: The robot cell.
        config: What is accepted.

    Raises:
        StartupError: If the state makes no sense, the arm moves, is near the end of a joint or touches something, the
            sensor is dead, disturbed or at its range, the tool is another than the rig's, the Jacobian is of another
            point than the pose, the tool does not give way by F / K, or torque does not accelerate as the inertia says.
    """
    config = config or StartupConfig()
    robot.read(controller.obs)
    joint_margin_rad = _check_state(controller.obs[0], rig, config)
    trial = Trial(
        robot,
        controller,
        config.impedance,
        torque_nm=config.contact_torque_nm,
        force_n=config.contact_force_n,
    )
    ramp = int(controller.ctl[0]["ramp_ticks"])
    rest = trial.hold(ramp + _ticks(config.rest_s)).last(_ticks(config.rest_s))
    noise = _check_sensor(rest, rig, config)
    rests, moves = _turn(trial, rest, config)
    _check_turns(rests, config)
    mass_kg, unloaded_n = _check_tool(rests, rig, config)
    kinematics = _check_kinematics(moves, config)
    compliance, strength = _check_pushes(trial, config)
    return StartupReport(
        joint_margin_rad=joint_margin_rad,
        noise=tuple(noise.tolist()),
        external_torque_nm=trial.external_torque_nm,
        contact_force_n=trial.contact_force_n,
        unloaded_n=unloaded_n,
        mass_kg=mass_kg,
        kinematics_m=kinematics[0],
        kinematics_rad=kinematics[1],
        compliance=compliance,
        strength=strength,
    )


def _ticks(seconds: float) -> int:
    return round(seconds / TICK_S)


def _check_state(state: np.void, rig: Rig, config: StartupConfig) -> float:
    """Refuse a state that no arm at rest can have, or one near a joint's end; returns the smallest margin [rad]."""
    for name in OBS.names or ():
        if not np.isfinite(state[name]).all():
            raise StartupError(f"the robot's state makes no sense: got {name} that is not finite, expected numbers.")
    off = float(np.abs(state["R"] @ state["R"].T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(state["R"]) < 0.0:
        raise StartupError(
            f"the robot's state makes no sense: got R that is off a rotation by {off:.3g}, expected one."
        )
    smallest = float(np.linalg.eigvalsh(state["M"]).min())
    if not (smallest > 0.0 and np.allclose(state["M"], state["M"].T)):
        raise StartupError(
            f"the robot's state makes no sense: got an inertia whose smallest eigenvalue is {smallest:.3g} kg m^2, "
            "expected it symmetric and above 0."
        )
    joint = int(np.abs(state["dq"]).argmax())
    if not abs(state["dq"][joint]) <= config.speed_max_rad_s:
        raise StartupError(
            f"the arm is not at rest: got {abs(state['dq'][joint]):.3g} rad/s in joint {joint + 1}, "
            f"expected {config.speed_max_rad_s:g} rad/s at most."
        )
    low, high = np.array(rig.robot.position_min_rad), np.array(rig.robot.position_max_rad)
    margins = np.minimum(state["q"] - low, high - state["q"])
    joint = int(margins.argmin())
    if not margins[joint] >= config.joint_margin_rad:
        raise StartupError(
            f"joint {joint + 1} is too near to its end: got {margins[joint]:.3g} rad left at {state['q'][joint]:.4g} "
            f"rad, expected {config.joint_margin_rad:g} rad at least."
        )
    return float(margins[joint])


def _check_sensor(rest: Seen, rig: Rig, config: StartupConfig) -> Float[np.ndarray, " 6"]:
    """Refuse a sensor that is dead, disturbed, or at its range; returns its noise at rest."""
    reading = rest.obs["wrench"]
    spread = reading.std(axis=0, ddof=1)
    least = config.noise_share_min * rig.sensor.noise
    most = config.noise_share_max * rig.sensor.noise + _NOISE_FLOOR
    for i in range(6):
        column, unit = WRENCH.columns[i], WRENCH.units[i]
        if not least[i] <= spread[i] <= most[i]:
            why = "it is dead or frozen" if spread[i] < least[i] else "it is disturbed, or the arm shakes"
            raise StartupError(
                f"the force sensor cannot be believed: got a noise of {spread[i]:.3g} {unit} in {column} at rest, "
                f"expected from {least[i]:.3g} to {most[i]:.3g} {unit}: {why}."
            )
        allowed = config.range_share_max * rig.sensor.range[i]
        if not (largest := np.abs(reading[:, i]).max()) <= allowed:
            raise StartupError(
                f"the force sensor is at its range: got {largest:.4g} {unit} in {column} at rest, expected "
                f"{allowed:.4g} {unit} at most."
            )
    return spread


def _turn(trial: Trial, rest: Seen, config: StartupConfig) -> tuple[list[Seen], list[Seen]]:
    """Turn the tool about the base's x, then its y, then back; returns the rests and all that moved."""
    listen = _ticks(config.listen_s)
    slowest = 1.5 * config.turn_rad / trial.controller.ctl[0]["turn_step_max"]
    turn = max(_ticks(config.turn_s), round(float(slowest)))
    R_home, rests, moves = rotation_of(trial.home[3:]), [rest], []
    for axis in np.eye(3)[:2]:
        pose = make_pose(trial.home[:3], exp_so3(config.turn_rad * axis) @ R_home)
        moves.append(trial.move(pose, turn))
        rests.append(trial.settle(listen))
    moves.append(trial.move(trial.home, turn))
    return rests, moves


def _check_turns(rests: Sequence[Seen], config: StartupConfig) -> None:
    """Refuse an arm that did not do as it was told: what it was asked for is what the other checks rest on."""
    R_home = rests[0].obs["R"][-1]
    for rest, axis in zip(rests[1:], "xy", strict=True):
        angle = float(np.linalg.norm(log_so3(rest.obs["R"][-1] @ R_home.T)))
        if not 0.5 * config.turn_rad <= angle <= 1.5 * config.turn_rad:
            raise StartupError(
                f"the tool did not turn about {axis} as asked: got {angle:.3g} rad, expected {config.turn_rad:g} rad "
                "within a half."
            )


def _check_tool(rests: Sequence[Seen], rig: Rig, config: StartupConfig) -> tuple[float, float]:
    """Refuse another tool than the rig's, and a force that none explains; returns mass [kg] and what is left [N].

    At rest the sensor reads f = m |g| u + bias, with u the way up in its axes. Differences between rests have no bias.
    """
    R_tcp_sensor = rotation_of(compose(inverse(np.array(rig.T_flange_tcp)), np.array(rig.sensor.T_flange_sensor))[3:])
    up = np.array([(rest.obs["R"] @ R_tcp_sensor)[:, 2, :].mean(axis=0) for rest in rests])
    force = np.array([rest.obs["wrench"][:, :3].mean(axis=0) for rest in rests])
    turned, changed = up[1:] - up[0], force[1:] - force[0]
    mass_kg = float((turned * changed).sum() / (GRAVITY_M_S2 * (turned**2).sum()))
    expected_kg = rig.payload.mass_kg
    tolerance_kg = max(config.mass_tolerance_kg, config.mass_tolerance_share * expected_kg)
    if not abs(mass_kg - expected_kg) <= tolerance_kg:
        raise StartupError(
            f"the tool is not the rig's: got {mass_kg:.3f} kg below the sensor, expected payload.mass_kg "
            f"{expected_kg:g} kg within {tolerance_kg:.3g} kg: a tool that is missing or another, or a sensor mounted "
            "otherwise."
        )
    unloaded_n = float(np.linalg.norm(force[0] - expected_kg * GRAVITY_M_S2 * up[0]))
    if not unloaded_n <= config.contact_force_n:
        raise StartupError(
            f"something touches the tool, or the sensor needs to be zeroed: got {unloaded_n:.3g} N at rest without the "
            f"tool's weight, expected {config.contact_force_n:g} N at most."
        )
    return mass_kg, unloaded_n


def _check_kinematics(moves: Sequence[Seen], config: StartupConfig) -> tuple[float, float]:
    """Refuse a pose and a Jacobian of different points; returns how far they come to be apart [m, rad].

    Way is summed up tick by tick, J dq with the mean of both ticks' J, so that it is exact to second order.
    """
    furthest = np.zeros(2)
    for move in moves:
        obs = move.obs
        J = 0.5 * (obs["J"][1:] + obs["J"][:-1])
        way = np.einsum("naj,nj->na", J, np.diff(obs["q"], axis=0)).cumsum(axis=0)
        turn = log_so3(obs["R"][1:] @ obs["R"][0].T)
        away = (obs["x"][1:] - obs["x"][0] - way[:, :3], turn - way[:, 3:])
        furthest = np.maximum(furthest, [np.linalg.norm(part, axis=1).max() for part in away])
    for got, expected, unit in zip(
        furthest, (config.kinematics_tolerance_m, config.kinematics_tolerance_rad), ("m", "rad"), strict=True
    ):
        if not got <= expected:
            raise StartupError(
                f"pose and Jacobian are not of one point: got {got:.3g} {unit} between where the tool went and where "
                f"the joints took it, expected {expected:g} {unit} at most: another tool centre point."
            )
    return float(furthest[0]), float(furthest[1])


def _check_pushes(trial: Trial, config: StartupConfig) -> tuple[tuple[float, ...], float]:
    """Lean against the spring along each axis; returns way over F / K an axis, and speed over what torque should give.

    At rest the tool must lie at F / K. That does not tell how strong the arm is: one whose torque is weak throughout
    pulls weakly with its spring and its push alike. What it gains in speed tells.
    """
    ticks, listen = _ticks(config.push_s), _ticks(config.listen_s)
    pushes, compliance, home = [], [], trial.settle(listen)
    state = trial.controller.ctl[0]
    push_n = float(min(config.push_n, 0.5 * state["force_max"], config.push_max_m * state["K_lin"].max()))
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        push = trial.push(np.concatenate([push_n * axis, np.zeros(3)]), ticks)
        expected_m = np.linalg.solve(state["K_lin"], push_n * axis)
        moved_m = trial.settle(listen).obs["x"].mean(axis=0) - home.obs["x"].mean(axis=0)
        if not np.linalg.norm(moved_m - expected_m) <= config.push_tolerance * np.linalg.norm(expected_m):
            raise StartupError(
                f"the tool does not give way as its stiffness says: a push of {push_n:.2g} N along {name} moved "
                f"it by {_mm(moved_m)} mm, expected {_mm(expected_m)} mm within {config.push_tolerance:.0%}."
            )
        compliance.append(float(moved_m @ axis / (expected_m @ axis)))
        pushes.append(push)
    trial.push(np.zeros(6), ticks)
    trial.settle(listen)
    strength = _strength(pushes)
    if not abs(strength - 1.0) <= config.strength_tolerance:
        raise StartupError(
            f"torque does not accelerate the arm as its inertia says: got {strength:.2f} of the speed that was due, "
            f"expected 1 within {config.strength_tolerance:.0%}: it is too weak, or carries more than it knows."
        )
    return tuple(compliance), strength


def _strength(pushes: Sequence[Seen], window: int = 20, windows: int = 10) -> float:
    """Speed gained over M^-1 times the torque's impulse, by least squares over the beginnings of some pushes."""
    gained, due = [], []
    for push in pushes:
        for first in range(0, window * windows, window):
            obs = push.obs[first : first + window + 1]
            net = push.command[first : first + window] - obs["coriolis"][:-1]
            gained.append(obs["dq"][-1] - obs["dq"][0])
            due.append(np.linalg.solve(obs["M"][window // 2], net.sum(axis=0) * TICK_S))
    expected = np.array(due)
    return float((expected * np.array(gained)).sum() / (expected**2).sum())


def _mm(vector_m: Float[np.ndarray, " 3"]) -> str:
    return " ".join(f"{1e3 * value:.1f}" for value in vector_m)
