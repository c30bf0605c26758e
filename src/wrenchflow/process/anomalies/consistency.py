"""The sensor against the joints: a wrong sign, a wrong frame, a payload that is set wrong, and a bias that drifts."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.arm_force import ArmForce
from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.finding import Finding, NotAssessed

SIGN, FRAME, PAYLOAD, DRIFT = "wrong-sign", "wrong-frame", "wrong-payload", "drift"
KINDS = (SIGN, FRAME, PAYLOAD, DRIFT)
DRIFT_N = 0.3  # Over the recording.
PAYLOAD_KG = 0.025
TURN_RAD = np.radians(15.0)  # Between the sensor's axes and those that the joints speak of.
_SIGMAS = 6.0
_TELLING = 10.0  # A force tells a direction that varies by as many times what the witnesses differ by, in one mean.
_SPREAD = 0.15  # Of the direction of gravity in the sensor's axes, as a share of its length: some 9 degrees.


def find_inconsistency(look: Look, witnesses: ArmForce | str) -> Iterator[Finding | NotAssessed]:
    """Compare what the sensor reads with what the joints feel.

    Args:
        look: The recording.
        witnesses: Both, or why there is only one.
    """
    if isinstance(witnesses, str):
        yield from (NotAssessed(kind=kind, reason=witnesses) for kind in KINDS)
        return
    both = witnesses
    span = {"start_ns": int(look.t[0]), "stop_ns": look.stop_ns(len(look.t) - 1), "samples": len(look.t)}
    names = look.columns[:3]
    turned = _turn(both)
    if isinstance(turned, str):
        yield from (NotAssessed(kind=kind, reason=turned) for kind in (SIGN, FRAME))
    else:
        sense, angle_rad = turned
        if sense < 0 and angle_rad <= TURN_RAD:
            evidence = "the sensor's force is the opposite of what the joints feel"
            yield Finding(kind=SIGN, severity="defect", columns=names, evidence=evidence, **span)
        if angle_rad > TURN_RAD:
            evidence = f"the sensor's force is turned by {np.degrees(angle_rad):.0f} degrees from what the joints feel"
            yield Finding(kind=FRAME, severity="defect", columns=names, evidence=evidence, **span)
        if sense < 0 or angle_rad > TURN_RAD:
            reason = "sensor and joints do not speak of the same force"
            yield from (NotAssessed(kind=kind, reason=reason) for kind in (PAYLOAD, DRIFT))
            return
    yield from _payload_and_drift(both, names, span)


def _turn(both: ArmForce) -> tuple[float, float] | str:
    """Sense and angle of the rotation that leads from the joints' force to the sensor's; or why nobody can tell.

    With two directions in which the force varies the rotation is known (Kabsch); a force that varies in one alone tells
    the sense, and the angle between both directions.
    """
    sensor, joints = _detrended(both.sensor), _detrended(both.joints)  # A drift is no direction.
    U, s, Vt = np.linalg.svd(sensor.T @ joints / len(sensor))
    # What both share shows in a correlation of the size of its own power.
    power = np.sqrt(s)
    noise = _noise(both)
    if power[0] < _TELLING * noise / np.sqrt(len(sensor)) or power[0] < 3.0 * noise:
        return f"the force varies by {power[0]:.2g} N, expected {3.0 * noise:.2g} N to tell directions"
    sense = 1.0
    direction_s, direction_j = U[:, 0], Vt[0]
    angle_rad = float(np.arccos(np.clip(direction_s @ direction_j, -1.0, 1.0)))
    if angle_rad > np.pi / 2.0:
        sense, angle_rad = -1.0, np.pi - angle_rad
    if power[1] > 3.0 * noise:
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
        R_flipped = U @ np.diag([-1.0, -1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
        angles = [float(np.arccos(np.clip((np.trace(each) - 1.0) / 2.0, -1.0, 1.0))) for each in (R, R_flipped)]
        angle_rad = min(angles) if sense > 0 else angles[1]
    return sense, angle_rad


def _detrended(force: np.ndarray) -> np.ndarray:
    time = np.linspace(-1.0, 1.0, len(force))
    return force - force.mean(axis=0) - np.outer(time, time @ force) / (time @ time)


def _noise(both: ArmForce) -> float:
    """Robust standard deviation of a mean's difference between the witnesses, from one to the next [N]."""
    change = np.diff(both.sensor - both.joints, axis=0)
    return float(1.4826 * np.median(np.abs(change)) / np.sqrt(2.0))


def _payload_and_drift(both: ArmForce, names: tuple[str, ...], span: dict) -> Iterator[Finding | NotAssessed]:
    """Fit bias, drift and a mass that is missing to the difference of the witnesses, by least squares."""
    time = (both.t - both.t.mean()) / (both.t[-1] - both.t[0])
    up = both.up - both.up.mean(axis=0)
    spread = float(np.sqrt((up**2).sum(axis=1).mean())) / 9.81
    knows_mass = spread > _SPREAD
    k = len(time)
    # Unknowns: bias (3), drift over the recording (3), and the mass that is not in the rig.
    columns = [np.eye(3)[None].repeat(k, axis=0), time[:, None, None] * np.eye(3)]
    A = np.concatenate([*columns, both.up[:, :, None]] if knows_mass else columns, axis=2).reshape(3 * k, -1)
    b = (both.sensor - both.joints).reshape(-1)
    x, *_ = np.linalg.lstsq(A, b)
    left = b - A @ x
    sigma = np.sqrt((left**2).sum() / (len(b) - A.shape[1]) * np.diag(np.linalg.inv(A.T @ A)))
    drift, known = np.abs(x[3:6]), sigma[3:6]
    beyond = (drift > DRIFT_N) & (drift > _SIGMAS * known)
    if beyond.any():
        seconds = (span["stop_ns"] - span["start_ns"]) * 1e-9
        worst = int(np.argmax(drift))
        yield Finding(
            kind=DRIFT,
            severity="warning",
            columns=tuple(np.array(names)[beyond].tolist()),
            evidence=f"{names[worst]} drifts by {x[3 + worst]:+.2g} N in {seconds:.3g} s against the joints "
            f"({60.0 * x[3 + worst] / seconds:+.2g} N/min), expected {DRIFT_N:g} N at most",
            **span,
        )
    if not knows_mass:
        reason = f"the tool turns too little to weigh it: gravity varies by {spread:.0%}, expected {_SPREAD:.0%}"
        yield NotAssessed(kind=PAYLOAD, reason=reason)
    elif abs(x[6]) > PAYLOAD_KG and abs(x[6]) > _SIGMAS * sigma[6]:
        yield Finding(
            kind=PAYLOAD,
            severity="defect",
            columns=names,
            evidence=f"the payload is {x[6]:+.3f} kg off what the rig says, to within {3.0 * sigma[6]:.3f} kg",
            **span,
        )
