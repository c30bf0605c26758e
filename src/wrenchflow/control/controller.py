"""The controller as a person configures it: from gains and a rig to the records that the kernels run on."""

import math
from collections.abc import Iterable
from operator import index

import numpy as np
from jaxtyping import Float

from wrenchflow.butterworth import design
from wrenchflow.control import impedance as law
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.fit import require_within
from wrenchflow.control.gate import state_is_sound
from wrenchflow.control.joint_speed import set_speed_limits
from wrenchflow.control.packet import ACCEPTED, PACKET, REASONS, UNIT_TOLERANCE
from wrenchflow.control.records import CTL, OBS, REQ
from wrenchflow.control.safeguards import GATE_REQUEST, LATCHED, MODES, SAFEGUARDS, cause_of, names_of
from wrenchflow.control.schedule import accept, make_schedule
from wrenchflow.errors import ControlError, unknown
from wrenchflow.rig import Rig
from wrenchflow.spatial import compose, inverse, log_so3, make_pose, rotation_of

TICK_S = 0.001
TICK_NS = 1_000_000
# Low-passes of the force that the safety layer feels: what presses, and what hits.
PRESS_HZ, IMPACT_HZ = 50.0, 200.0
_SILENT_PERIODS = 2.5
_PATIENCE_MIN_S = 0.1


def patience_ticks(every_s: float) -> int:
    """After how many ticks of silence the arm holds, if something is asked every so often; 0 for never."""
    if math.isinf(every_s):
        return 0
    return math.ceil(round(max(_SILENT_PERIODS * every_s, _PATIENCE_MIN_S) / TICK_S, 6))


class Controller:
    """One arm's controller: an observation, a request and the state, each one record.

    The torque of a tick is `J^T (K e - D V + F_d) + N tau_null + c(q, dq)`, governed and limited; see
    `control.impedance`. It waits until something is asked for, and holds when nobody asks any more.
    """

    def __init__(self, rig: Rig, config: ControlConfig, *, without: Iterable[str] = ()) -> None:
        """Take the limits of `rig`; `start` must be called before the first `tick`.

        Args:
            rig: The robot cell.
            config: Limits and gains.
            without: Names of safeguards that are left out, to see what each is worth; in simulation only.

        Raises:
            ConfigError: If the configuration is beyond what the hardware bears; see `control.fit`.
            ControlError: If no safeguard has such a name.
        """
        require_within(config, rig)
        self.obs = np.zeros(1, OBS)
        self.req = np.zeros(1, REQ)
        self.ctl = np.zeros(1, CTL)
        self.schedule = make_schedule(
            rig.workspace.min_m, rig.workspace.max_m, actuation_latency_s=config.actuation_latency_s
        )
        state = self.ctl[0]
        for name in without:
            if name not in SAFEGUARDS:
                raise ControlError(unknown("safeguard", name, SAFEGUARDS))
            state["without"] |= 1 << list(SAFEGUARDS).index(name)
        _set_limits(state, rig, config)
        _set_energy(state, config)
        _set_triggers(state, rig, config)
        _set_sensor(state, rig)
        set_speed_limits(self.ctl, rig.robot)
        self.set_contact_zone(np.full(3, np.inf), np.full(3, -np.inf))

    def set_contact_zone(self, min_m: Float[np.ndarray, " 3"], max_m: Float[np.ndarray, " 3"]) -> None:
        """Say where contact is expected, as a box in the base frame; there the reference is slow.

        Where a minimum is above its maximum there is no such place.

        Raises:
            ControlError: If a corner is not a number.
        """
        if np.isnan([min_m, max_m]).any():
            raise ControlError(f"a contact zone from {min_m} to {max_m} is none.")
        self.ctl[0]["zone_min"], self.ctl[0]["zone_max"] = min_m, max_m

    def start(self, impedance: Impedance) -> None:
        """Begin at the observed pose, which becomes the target, and wait for the first request.

        Raises:
            ControlError: If the arm is latched, which only `reset` ends, or cannot be read.
        """
        state = self.ctl[0]
        if state["mode"] == LATCHED or state["is_stop_asked"]:
            raise ControlError("a stopped arm does not start: an operator has to end the stop with reset().")
        self._require_readable()
        state["K_lin_target"] = np.eye(3) * impedance.translation_n_m
        state["K_rot_target"] = np.eye(3) * impedance.rotation_nm_rad
        state["damping_ratio_target"] = impedance.damping_ratio
        law.clamp_both(state)
        state["takes_bias"], state["bias_ticks"], state["bias"] = 1, 0, 0.0
        state["rejected"], state["counts"] = 0, 0
        for name in ("damped", "fed", "posed", "saturated", "exerted", "filled"):
            state[name] = 0.0
        law.start(self.obs[0], self.schedule[0], state)

    def reset(self) -> None:
        """Let an operator end a latched stop: wait again, where the arm is now, with the bias that it had.

        Raises:
            ControlError: If the arm is not latched, or cannot be read.
        """
        state, obs = self.ctl[0], self.obs[0]
        if state["mode"] != LATCHED:
            raise ControlError(f"only what is latched can be reset; the mode is '{self.mode}'.")
        self._require_readable()
        state["takes_bias"] = 0
        law.start(obs, self.schedule[0], state)

    def tare_again(self) -> None:
        """Forget the bias that was taken so far, which something disturbed; while the arm waits it is taken anew."""
        self.ctl[0]["bias_ticks"], self.ctl[0]["bias"] = 0, 0.0

    def _require_readable(self) -> None:
        if not state_is_sound(self.obs[0]):
            raise ControlError("the robot's state is not finite, or as no arm can be: control cannot begin.")

    def stop(self) -> None:
        """Emergency stop, in any mode: from the next tick on the joints are braked until the operator resets."""
        self.ctl[0]["is_stop_asked"] = 1

    @property
    def mode(self) -> str:
        """The mode's name: run, hold, retreat, soft-stop or latched."""
        return MODES[int(self.ctl[0]["mode"])]

    @property
    def latched_s(self) -> float:
        """For how long the arm has been latched, and could be read [s]; 0 where it is not."""
        state = self.ctl[0]
        return float(state["mode_tick"]) * TICK_S if state["mode"] == LATCHED else 0.0

    @property
    def cause(self) -> str:
        """Name of the safeguard that changed the mode; `none` where none did."""
        return cause_of(int(self.ctl[0]["cause"]))

    @property
    def acting(self) -> tuple[str, ...]:
        """Names of the safeguards that intervened at the last tick."""
        return names_of(int(self.ctl[0]["acting"]))

    @property
    def interventions(self) -> dict[str, int]:
        """In how many ticks each safeguard intervened since the start, those that did."""
        counts = self.ctl[0]["counts"]
        return {name: int(counts[number]) for number, name in enumerate(SAFEGUARDS) if counts[number]}

    @property
    def target_pose(self) -> Float[np.ndarray, " 7"]:
        """The target asked for at the last tick, before leash and limits."""
        return make_pose(self.ctl[0]["x_target"].copy(), self.ctl[0]["R_target"].copy())

    def ask(
        self,
        start: Float[np.ndarray, " 7"],
        stop: Float[np.ndarray, " 7"],
        *,
        ticks: int,
        impedance: Impedance,
        wrench: Float[np.ndarray, " 6"] | None = None,
        disturbance_m: Float[np.ndarray, " 3"] | None = None,
        every_s: float = math.inf,
    ) -> None:
        """Ask for a straight segment of the target, and to stay at its end.

        Args:
            start: Target at the beginning of the segment.
            stop: Target at its end.
            ticks: How long it lasts.
            impedance: How stiffly it is followed.
            wrench: Feed-forward: exerted besides the spring's, base axes, about the TCP [N, N.m]. Shape (6,).
            disturbance_m: Added to what is tracked, not to the target that is recorded [m]; it goes there from the last
                one in a straight line, as the target does. Shape (3,).
            every_s: How often this is asked anew [s]: silence of 2.5 times this (100 ms at least) is a hold. Infinity
                for a request that does not expire.

        Raises:
            ControlError: If this is no request at all: a wrong shape or type, no tick, or a time below 0. Nothing of it
                is asked then. One whose values cannot be meant is counted instead, see `refusals`.
        """
        try:
            asked = _request(start, stop, ticks, impedance, wrench, disturbance_m, every_s)
        except (TypeError, ValueError, OverflowError, AttributeError, IndexError) as error:
            raise ControlError(f"this cannot be asked for: {error}") from error
        self.req[:] = asked
        self.ctl[0]["is_asked"] = 1

    def accept(self, packet: np.ndarray, now_ns: int) -> str:
        """Take in a plan, to be followed from the next tick on if it is sound.

        Args:
            packet: What a policy sent. Shape (1,), dtype `PACKET`.
            now_ns: The loop's time, on the clock of the robot's stamps: that of the next tick, or the last one's.

        Returns:
            What became of it, one of `packet.REASONS`; `accepted`, or why it is counted and not followed.

        Raises:
            ControlError: If this is no packet.
        """
        if not isinstance(packet, np.ndarray) or packet.dtype != PACKET or packet.shape != (1,):
            got = f"{packet.dtype} of shape {packet.shape}" if isinstance(packet, np.ndarray) else type(packet).__name__
            raise ControlError(f"a plan is one record of dtype PACKET, shape (1,); got {got[:80]}.")
        state = self.ctl[0]
        reason = accept(packet[0], self.schedule[0], state, now_ns)
        if reason == ACCEPTED:
            state["is_fresh"], state["is_asked"] = 1, 0
            state["patience_ticks"] = patience_ticks(int(self.schedule["period_ns"][0]) * 1e-9)
        else:
            state["pending"] |= 1 << GATE_REQUEST
            state["rejected"] += 1
        return tuple(REASONS)[reason]

    @property
    def refusals(self) -> dict[str, int]:
        """How many plans were refused since the start, by reason, those that were; segments as `segment`."""
        counts = self.schedule["counts"][0]
        plans = {name: int(counts[number]) for number, name in enumerate(REASONS) if number != ACCEPTED}
        segments = int(self.ctl["rejected"][0]) - sum(plans.values())
        return {name: count for name, count in {**plans, "segment": segments}.items() if count}

    def tick(self) -> Float[np.ndarray, " 7"]:
        """Decide one tick's torque [N.m], without gravity, from `obs` and `req`. Shape (7,), a view of the state."""
        law.tick_each(self.obs, self.req, self.schedule, self.ctl)
        return self.ctl["tau"][0]


def _request(
    start: np.ndarray,
    stop: np.ndarray,
    ticks: int,
    impedance: Impedance,
    wrench: np.ndarray | None,
    disturbance_m: np.ndarray | None,
    every_s: float,
) -> np.ndarray:
    """A record of what is asked for, made as a whole before any of it is heard. Shape (1,), dtype `REQ`."""
    if index(ticks) < 1:
        raise ControlError(f"a segment lasts at least 1 tick, got {ticks}.")
    if not every_s > 0.0:
        raise ControlError(f"every_s is {every_s:g}, expected above 0; infinity for what does not expire.")
    asked = np.zeros(1, REQ)
    req = asked[0]
    R_start, R_stop = _rotation(start), _rotation(stop)
    req["x_start"], req["x_stop"], req["R_start"] = start[:3], stop[:3], R_start
    req["turn"] = log_so3(R_stop @ R_start.T) if np.isfinite(R_stop).all() and np.isfinite(R_start).all() else np.nan
    req["ticks"] = ticks
    req["K_lin"] = np.eye(3) * impedance.translation_n_m
    req["K_rot"] = np.eye(3) * impedance.rotation_nm_rad
    req["damping_ratio"] = impedance.damping_ratio
    req["wrench"] = 0.0 if wrench is None else wrench
    req["x_offset"] = 0.0 if disturbance_m is None else disturbance_m
    req["patience_ticks"] = patience_ticks(every_s)
    return asked


def _rotation(pose: np.ndarray) -> np.ndarray:
    """The rotation of a pose, or NaN, which the gate refuses, where its quaternion is not of unit length."""
    if np.shape(pose) != (7,):
        raise ControlError(f"a pose is of shape (7,), got {np.shape(pose)}.")
    is_unit = abs(float(np.linalg.norm(pose[3:])) - 1.0) <= UNIT_TOLERANCE
    return rotation_of(pose[3:]) if is_unit else np.full((3, 3), np.nan)


def _ticks(seconds: float) -> int:
    return max(1, round(seconds / TICK_S))


def _set_limits(state: np.void, rig: Rig, config: ControlConfig) -> None:
    """Ranges and speeds of what is asked and given."""
    state["null_stiffness"] = config.nullspace_nm_rad
    state["ramp_ticks"] = round(config.ramp_s / TICK_S)
    state["design_ticks"] = _ticks(1.0 / config.damping_design_hz)
    state["tau_max"] = np.array(rig.robot.torque_nm) * config.torque_share
    state["tau_step_max"] = np.array(rig.robot.torque_rate_nm_s) * config.torque_rate_share * TICK_S
    state["force_max"], state["moment_max"] = config.force_max_n, config.moment_max_nm
    state["x_step_max"] = config.speed_max_m_s * TICK_S
    state["turn_step_max"] = config.turn_max_rad_s * TICK_S
    state["zone_step_max"] = config.zone_speed_m_s * TICK_S
    state["zone_slowing"] = TICK_S / config.zone_slowing_s
    state["arm_speed_share"], state["brake_rate"] = config.arm_speed_share, 1.0 / config.brake_s
    state["workspace_min"], state["workspace_max"] = rig.workspace.min_m, rig.workspace.max_m
    state["K_lin_min"], state["K_lin_max"] = config.stiffness_min_n_m, config.stiffness_max_n_m
    state["K_rot_min"], state["K_rot_max"] = config.stiffness_min_nm_rad, config.stiffness_max_nm_rad
    state["K_lin_fall_max"] = config.stiffness_fall_n_m_s * TICK_S
    state["K_rot_fall_max"] = config.stiffness_fall_nm_rad_s * TICK_S
    state["damping_ratio_min"], state["damping_ratio_max"] = config.damping_ratio_min, config.damping_ratio_max
    state["inertia_lin_max"], state["inertia_rot_max"] = config.slew_inertia_kg, config.slew_inertia_kg_m2


def _set_energy(state: np.void, config: ControlConfig) -> None:
    """The tank, and what guards the budget."""
    state["tank_start"], state["tank_max"] = config.tank_start_j, config.tank_max_j
    state["tank_reserve"], state["tank_fill"] = config.tank_reserve_j, config.tank_fill_w * TICK_S
    state["refill_share"] = config.tank_refill_share
    state["overdraft_ticks_max"] = _ticks(config.observer_patience_s)
    state["observer_damping"], state["brake"] = config.observer_damping_nm_s_rad, config.brake_nm_s_rad


def _set_triggers(state: np.void, rig: Rig, config: ControlConfig) -> None:
    """What changes the mode, and for how long a mode lasts."""
    state["hold_ticks_max"] = _ticks(config.hold_max_s)
    state["stop_step"] = 1.0 / _ticks(config.stop_s)
    state["retreat_m"], state["retreat_ticks_max"] = config.retreat_m, _ticks(config.retreat_max_s)
    state["retreat_force"], state["retreat_moment"] = config.retreat_force_n, config.retreat_moment_nm
    state["retreat_patience_ticks"] = _ticks(config.retreat_patience_s)
    state["impact_force"] = config.impact_force_n
    state["dq_share"] = config.joint_speed_share
    state["q_min"], state["q_max"] = rig.robot.position_min_rad, rig.robot.position_max_rad
    state["q_margin"] = config.joint_margin_rad
    state["overrun_ns"], state["overrun_max_ns"] = round(config.overrun_s * 1e9), round(config.overrun_max_s * 1e9)
    state["overruns_max"], state["stale_ticks_max"] = config.overruns_max, _ticks(config.stale_s)
    # A reading that comes at a lower rate is the same for longer; one without noise is the same for ever.
    slow = max(1.0, 1.0 / (rig.sensor.rate_hz * TICK_S))
    has_noise = rig.sensor.noise_force_n > 0.0 and rig.sensor.noise_torque_nm > 0.0
    state["dead_ticks_max"] = round(_ticks(config.frozen_s) * slow)
    state["frozen_ticks_max"] = state["dead_ticks_max"] if has_noise else 0


def _set_sensor(state: np.void, rig: Rig) -> None:
    """Where the sensor sits, what hangs below it, and the low-passes."""
    T_tcp_sensor = compose(inverse(np.array(rig.T_flange_tcp)), np.array(rig.sensor.T_flange_sensor))
    state["R_tcp_sensor"] = rotation_of(T_tcp_sensor[3:])
    # The arm of the force about the TCP, in the sensor's axes.
    state["x_tcp_sensor"] = rotation_of(T_tcp_sensor[3:]).T @ T_tcp_sensor[:3]
    state["payload_kg"], state["payload_com"] = rig.payload.mass_kg, rig.payload.com_sensor_m
    state["wrench_sos"], state["impact_sos"] = design(PRESS_HZ, 1.0 / TICK_S, 2), design(IMPACT_HZ, 1.0 / TICK_S, 2)
