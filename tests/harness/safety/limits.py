"""Limits that hold at every tick whatever is asked: torque and its rate, finite numbers, leash, force of contact."""

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from safety.findings import Finding, worst_of
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig
from wrenchflow.control.safeguards import LATCHED, LEASH, LEASH_ROTATION, RETREAT, TANK_DEBT
from wrenchflow.rig import Rig

TICK_S = 0.001
# A float is rounded once or twice on the way to its limit.
ROUNDING = 1.0 + 1e-9
LOWPASS_HZ = 50.0
# A force counts as quasi-static once the tool has been slower than this for that long: an impact has rung down by then.
# A peg that turns about its tip hits too, so its turning counts, as speed of a point that is 0.1 m away.
REST_M_S, REST_S, LEVER_M = 0.01, 0.1, 0.1
STANDSTILL_M_S = 0.001
QUASI_STATIC_SHARE = 1.1
IMPACT_1_S = 150.0


def check_torque(trace: Trace, rig: Rig, config: ControlConfig) -> list[Finding]:
    """I3: torque and its change in a tick, against the hardware's limits and against the share that is configured."""
    tau = trace.after["tau"]
    steps = np.abs(tau - np.concatenate([trace.before["tau"][:1], tau[:-1]]))
    torque, rate = np.array(rig.robot.torque_nm), np.array(rig.robot.torque_rate_nm_s) * TICK_S
    return [
        worst_of("I3 torque", np.abs(tau) / torque, config.torque_share * ROUNDING),
        worst_of("I3 torque rate", steps / rate, config.torque_rate_share * ROUNDING),
    ]


def check_finite(trace: Trace) -> list[Finding]:
    """I4: nothing non-finite leaves, and nothing non-finite is remembered of what the next torque rests on."""
    names = ("tau", "x_d", "R_d", "K_lin", "K_rot", "D", "P", "tank", "spring", "budget", "wrench_command")
    bad = np.zeros(len(trace), bool)
    for name in names:
        bad |= ~np.isfinite(trace.after[name].reshape(len(trace), -1)).all(1)
    return [worst_of("I4 finite", bad.astype(float), 0.0)]


def check_leash(trace: Trace, config: ControlConfig) -> list[Finding]:
    """I10: after every tick the reference is as near to the tool, as it was seen, as its spring may pull."""
    after, obs = trace.after, trace.obs
    # What is latched follows nothing.
    seen = np.isfinite(obs["x"]).all(1) & np.isfinite(obs["R"]).all((1, 2)) & (after["mode"] != LATCHED)
    rows = np.abs(after["K_lin"]).sum(2)
    pull = rows * np.abs(after["x_d"] - obs["x"])
    stiffest = np.abs(after["K_rot"]).sum(2).max(1)
    turn = np.zeros(len(trace))
    turn[seen] = Rotation.from_matrix(np.einsum("nij,nkj->nik", after["R_d"][seen], obs["R"][seen])).magnitude()
    # An angle is known to about a hundred-millionth of a radian near zero.
    slack = 1e-7 * stiffest
    return [
        worst_of("I10 leash [N]", pull, config.force_max_n * ROUNDING, seen),
        worst_of("I10 leash [N.m]", stiffest * turn - slack, config.moment_max_nm * ROUNDING, seen),
    ]


def check_speed(trace: Trace, config: ControlConfig) -> list[Finding]:
    """The reference goes no faster than allowed where nothing pulls it back: not the leash, not a debt, not a mode.

    In the zone where contact is expected, tool and reference both in it, it has that zone's speed.
    """
    before, after = trace.before, trace.after
    pulled = 1 << LEASH | 1 << LEASH_ROTATION | 1 << TANK_DEBT
    voluntary = (after["acting"] & pulled == 0) & (before["mode"] == after["mode"]) & (after["mode"] <= RETREAT)
    voluntary &= (before["tick"] > 0) & np.isfinite(after["R_d"]).all((1, 2)) & np.isfinite(before["R_d"]).all((1, 2))
    speed = np.sqrt(((after["x_d"] - before["x_d"]) ** 2).sum(1)) / TICK_S
    inside = voluntary.copy()
    for place in (trace.obs["x"], before["x_d"], after["x_d"]):
        inside &= ((place >= after["zone_min"]) & (place <= after["zone_max"])).all(1)
    turned = np.full(len(trace), -np.inf)
    steps = np.einsum("nij,nkj->nik", after["R_d"][voluntary], before["R_d"][voluntary])
    turned[voluntary] = Rotation.from_matrix(steps).magnitude() / TICK_S if voluntary.any() else 0.0
    return [
        worst_of("speed of the reference [m/s]", speed, config.speed_max_m_s * (1.0 + 1e-6), voluntary),
        worst_of("speed of the reference in the zone [m/s]", speed, config.zone_speed_m_s * (1.0 + 1e-6), inside),
        worst_of("turning of the reference [rad/s]", turned, config.turn_max_rad_s * (1.0 + 1e-4), voluntary),
    ]


def check_caps(trace: Trace, config: ControlConfig) -> list[Finding]:
    """Feed-forward is given within the caps of force and moment."""
    given = trace.after["wrench_command"]
    force, moment = (np.sqrt((given[:, half] ** 2).sum(1)) for half in (slice(0, 3), slice(3, 6)))
    return [
        worst_of("feed-forward [N]", force, config.force_max_n * ROUNDING),
        worst_of("feed-forward [N.m]", moment, config.moment_max_nm * ROUNDING),
    ]


def check_workspace(trace: Trace, rig: Rig) -> list[Finding]:
    """The reference stays in the workspace while the tool is in it."""
    low, high = np.array(rig.workspace.min_m), np.array(rig.workspace.max_m)
    inside = ((trace.obs["x"] > low) & (trace.obs["x"] < high)).all(1) & (trace.after["mode"] != LATCHED)
    x_d = trace.after["x_d"]
    return [worst_of("reference outside the workspace [m]", np.maximum(low - x_d, x_d - high), 1e-9, inside)]


def inertia_along(trace: Trace, force: np.ndarray) -> np.ndarray:
    """Inertia that the tool has along a force [kg], NaN where there is none. Shapes (n, 3) and (n,)."""
    size = np.sqrt((force**2).sum(1))
    inertia, touching = np.full(len(trace), np.nan), size > 1e-6
    n = force[touching] / size[touching, None]
    pushed = np.einsum("na,naj->nj", n, trace.truth["J"][touching, :3])
    inertia[touching] = 1.0 / np.einsum(
        "nj,nj->n", pushed, np.linalg.solve(trace.truth["M"][touching], pushed[..., None])[..., 0]
    )
    return inertia


def check_contact(trace: Trace, config: ControlConfig) -> list[Finding]:
    """I9 and the contact force: at rest the cap, quasi-static a tenth more, in an impact what inertia adds.

    The force is MuJoCo's, low-passed at 50 Hz. Quasi-static is a tick before which the tool has been slower than
    10 mm/s for 100 ms; what is not is an impact, and may be over by 150 1/s times the inertia along the force times
    the speed that is allowed near contact.
    """
    force = trace.truth["contact"]
    smooth = np.asarray(sosfilt(butter(2, LOWPASS_HZ, fs=1.0 / TICK_S, output="sos"), force, axis=0))
    size = np.sqrt((smooth**2).sum(1))
    speed = np.sqrt((trace.twist[:, :3] ** 2).sum(1)) + LEVER_M * np.sqrt((trace.twist[:, 3:] ** 2).sum(1))
    width = round(REST_S / TICK_S)
    recent = maximum_filter1d(speed, width, origin=(width - 1) // 2, mode="nearest")
    pushed = trace.is_pushed.astype(np.uint8)
    alone = maximum_filter1d(pushed, 2 * width, origin=(2 * width - 1) // 2, mode="nearest") == 0
    quasi_static = (recent < REST_M_S) & alone
    still = (recent < STANDSTILL_M_S) & alone
    # Along the force that is bounded: that of the moment may already point elsewhere when the low-pass is at its peak.
    inertia = inertia_along(trace, smooth)
    impact = (size - QUASI_STATIC_SHARE * config.force_max_n) / (IMPACT_1_S * inertia * config.zone_speed_m_s)
    return [
        worst_of("I9 static force [N]", np.abs(smooth), config.force_max_n * 1.01, still),
        worst_of("contact quasi-static [N]", size, config.force_max_n * QUASI_STATIC_SHARE, quasi_static),
        worst_of("contact impact [150/s m v]", impact, 1.0, ~quasi_static & alone & np.isfinite(inertia)),
    ]
