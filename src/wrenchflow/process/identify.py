"""From recordings of rests to a calibration that is accepted, or a reason why there is none."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from wrenchflow.calibration import FOUND, Calibration, Six, SourceFile
from wrenchflow.episode import Episode
from wrenchflow.errors import CalibrationError, WrenchflowError
from wrenchflow.process.calibrate_config import AcceptConfig, IdentifyConfig
from wrenchflow.process.payload import MAX_CONDITION, MIN_ORIENTATIONS, PayloadEstimate, identify_payload
from wrenchflow.process.rests import Rest, effective_samples, find_rests, standard_errors
from wrenchflow.rig import Rig


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """A payload, and the rests that tell it.

    Attributes:
        estimate: What hangs below the sensor.
        rests: Of all recordings, in their order.
        errors: Standard deviation of each mean reading. Shape (k, 6).
        recordings: Number of the recording of each. Shape (k,).
    """

    estimate: PayloadEstimate
    rests: tuple[Rest, ...]
    errors: Float[np.ndarray, "k 6"]
    recordings: Int[np.ndarray, " k"]


def identify(episodes: Sequence[Episode], rig: Rig, config: IdentifyConfig | None = None) -> Identified:
    """Find out what hangs below the sensor, from the rests of some recordings.

    Args:
        episodes: With `wrench_raw` and `tcp_pose`; each has a bias of its own.
        rig: Sensor and mount; its payload is not looked at.
        config: What a rest is, what else may be wrong, and what is accepted.

    Raises:
        CalibrationError: If a recording has no rests that can be used, there are too few orientations or all are
            alike, or the result is none: see `AcceptConfig`.
        StreamError: If a stream is missing, or is not what it says.
    """
    config = config or IdentifyConfig()
    found = []
    for episode in episodes:
        try:
            found.append(find_rests(episode, rig, config.rests))
        except WrenchflowError as error:
            raise type(error)(f"'{episode.id}': {error}") from error
    rests = [rest for each in found for rest in each]
    recordings = np.repeat(np.arange(len(found)), [len(each) for each in found])
    if len(rests) < MIN_ORIENTATIONS:
        raise CalibrationError(f"a payload takes {MIN_ORIENTATIONS} orientations at least, got {len(rests)} rests.")
    errors = standard_errors(rests)
    estimate = identify_payload(
        np.array([rest.R_base_sensor for rest in rests]),
        np.array([rest.mean for rest in rests]),
        errors,
        minutes=np.array([rest.middle_ns - rests[0].middle_ns for rest in rests]) / 60e9,
        recordings=recordings,
        doubt=config.doubt,
    )
    _check(estimate, rests, errors, config.accept)
    return Identified(estimate=estimate, rests=tuple(rests), errors=errors, recordings=recordings)


def _check(
    estimate: PayloadEstimate, rests: Sequence[Rest], errors: Float[np.ndarray, "k 6"], accept: AcceptConfig
) -> None:
    """Refuse what cannot be believed."""
    for unit, limit, part in (("N", accept.max_left_n, slice(0, 3)), ("N.m", accept.max_left_nm, slice(3, 6))):
        # Noise is granted on top: three standard deviations of a rest's mean reading.
        left = np.linalg.norm(estimate.left[:, part], axis=1)
        allowed = limit + 3.0 * np.linalg.norm(errors[:, part], axis=1)
        worst = int(np.argmax(left / allowed))
        if not left[worst] <= allowed[worst]:
            raise CalibrationError(
                f"no payload explains all rests: rest {worst + 1} of {len(rests)} is off by {left[worst]:.3g} {unit}, "
                f"expected {allowed[worst]:.3g} {unit} at most: something touched the tool there, the tool hangs "
                "loose, or the sensor's frame or sign is another."
            )
    payload = estimate.payload
    if not estimate.mass_std_kg <= accept.max_mass_std_share * payload.mass_kg:
        raise CalibrationError(
            f"the mass is not told well enough: got {payload.mass_kg:.3g} kg with a standard deviation of "
            f"{estimate.mass_std_kg:.2g} kg, expected {accept.max_mass_std_share:.0%} of it at most. Rest longer, tilt "
            "the tool further, or nothing hangs there."
        )
    away_m = float(np.linalg.norm(payload.com_sensor_m))
    if not away_m <= accept.max_com_m:
        raise CalibrationError(
            f"the centre of mass lies where no tool is: got {away_m:.3g} m from the sensor, expected "
            f"{accept.max_com_m:g} m at most. The moments' units or frame may be wrong."
        )


def calibration_of(
    identified: Identified, rig: Rig, sources: Sequence[tuple[str, str]], accept: AcceptConfig, date: str
) -> Calibration:
    """What was found, as it is kept.

    Args:
        identified: By `identify`.
        rig: That it was identified with.
        sources: Name and sha256 of the file of each recording.
        accept: What would have been refused.
        date: The day, as in 2025-12-31.
    """
    estimate, rests = identified.estimate, list(identified.rests)
    std = np.sqrt(np.diag(estimate.covariance))
    x, y, z = estimate.com_std_m.tolist()
    return Calibration(
        verdict=FOUND,
        date=date,
        sensor=rig.sensor.name,
        T_flange_sensor=rig.sensor.T_flange_sensor,
        payload=estimate.payload,
        mass_std_kg=estimate.mass_std_kg,
        com_std_m=(x, y, z),
        bias=_six(estimate.bias),
        bias_std=_six(std[4:]),
        covariance=tuple(tuple(row) for row in estimate.covariance.tolist()),
        residual=_six(estimate.residual),
        left_n=float(np.linalg.norm(estimate.left[:, :3], axis=1).max()),
        left_nm=float(np.linalg.norm(estimate.left[:, 3:], axis=1).max()),
        condition=estimate.condition,
        chance=estimate.chance,
        rests=len(rests),
        effective=_six(effective_samples(rests)),
        limits={
            "max_condition": MAX_CONDITION,
            "max_left_n": accept.max_left_n,
            "max_left_nm": accept.max_left_nm,
            "max_com_m": accept.max_com_m,
            "max_mass_std_share": accept.max_mass_std_share,
        },
        sources=tuple(
            SourceFile(file=file, sha256=sha256, rests=int((identified.recordings == number).sum()))
            for number, (file, sha256) in enumerate(sources)
        ),
    )


def _six(values: Float[np.ndarray, " 6"]) -> Six:
    a, b, c, d, e, f = values.tolist()
    return a, b, c, d, e, f
