"""Where an arm rested in a recording, and what its sensor read there, with how well a mean of it is known."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import RestConfig
from wrenchflow.process.means import FLOOR, blocks_of
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import check_raw, finite, held_pose
from wrenchflow.process.still import mean_rotation, still_spans
from wrenchflow.rig import Rig
from wrenchflow.signals import WRENCH
from wrenchflow.spatial import log_so3, rotation_of

REST = "rest"
_MIN_SAMPLES = 8  # In a rest: fewer do not tell how much they scatter.
_LACKING = 0.2  # Share of its least length that a rest may lack.
_MIN_BLOCKS = 8  # In all rests together: fewer do not tell how much their means scatter.


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """One rest.

    Attributes:
        start_ns: Where it begins [ns].
        stop_ns: Where it ends, exclusive [ns].
        R_base_sensor: Mean orientation of the sensor. Shape (3, 3).
        mean: Mean reading, sensor frame [N, N.m]. Shape (6,).
        std: Standard deviation of one sample. Shape (6,).
        blocks: Means of stretches of 50 ms, or of half of it where it is shorter. Shape (n, 6).
        samples: How many samples it has.
    """

    start_ns: int
    stop_ns: int
    R_base_sensor: Float[np.ndarray, "3 3"]
    mean: Float[np.ndarray, " 6"]
    std: Float[np.ndarray, " 6"]
    blocks: Float[np.ndarray, "n 6"]
    samples: int

    @property
    def middle_ns(self) -> int:
        """When it was [ns]."""
        return (self.start_ns + self.stop_ns) // 2


def marked_rests(episode: Episode) -> list[tuple[int, int]]:
    """Start and end [ns] of the phases `rest 1`, `rest 2` and so on, in their order."""
    return [
        (event.start_ns, event.stop_ns) for event in episode.events_of("phase") if event.label.partition(" ")[0] == REST
    ]


def find_rests(episode: Episode, rig: Rig, config: RestConfig | None = None) -> list[Rest]:
    """The rests of a recording: its phases `rest 1` and so on, or else wherever the tool stood still.

    Args:
        episode: With `wrench_raw` and `tcp_pose`, and `joint_states` where somebody recorded them.
        rig: Sensor and mount.
        config: What a rest is.

    Raises:
        CalibrationError: If there is none, or one that is marked is none: too short, without finite samples, the joints
            or the tool move, or the reading spreads or drifts.
        StreamError: If `wrench_raw` is no wrench in the sensor frame, or a pose has no unit quaternion.
    """
    config = config or RestConfig()
    raw, pose = episode["wrench_raw"], episode["tcp_pose"]
    check_raw(raw)
    if raw.signal != WRENCH:
        raise CalibrationError(
            "a sensor without moments tells no centre of mass: got forces only, expected a force/torque sensor."
        )
    raw = finite(raw)
    dead = [name for name, of in zip(raw.signal.columns, raw.data.T, strict=True) if len(of) > 1 and np.ptp(of) == 0.0]
    if dead:
        raise CalibrationError(f"the reading never changes in {', '.join(dead)}: expected a sensor that reads noise.")
    held_pose(pose, raw.t)  # Poses that are none are told of before anything is looked for in them.
    marked = marked_rests(episode)
    joints = episode.streams.get("joint_states")
    spans = marked or still_spans(pose, joints, config)
    if not spans:
        raise CalibrationError(
            f"the arm never rests: got no span of {config.min_s:g} s without motion, expected "
            "one at each of several ways to hold the tool."
        )
    rests = []
    for number, (start_ns, stop_ns) in enumerate(spans, start=1):
        try:
            rests.append(_rest(raw, pose, joints, rig, start_ns, stop_ns, config))
        except CalibrationError as error:
            if marked:
                raise CalibrationError(f"rest {number} of {len(spans)} cannot be used: {error}") from error
    if not rests:
        raise CalibrationError(
            f"no rest can be used: {len(spans)} spans are without motion, in all of which the reading "
            "is missing, spreads or drifts."
        )
    return rests


def _rest(
    raw: Stream, pose: Stream, joints: Stream | None, rig: Rig, start_ns: int, stop_ns: int, config: RestConfig
) -> Rest:
    part = raw.between(start_ns, stop_ns)
    before, poses = held_pose(pose, part.t)
    t, rows = part.t[before:], part.data[before:]
    period_s = float(np.median(np.diff(raw.t))) * 1e-9 if len(raw) > 1 else np.inf
    if len(t) < _MIN_SAMPLES or len(t) * period_s < config.min_s * (1.0 - _LACKING):
        raise CalibrationError(
            f"got {len(t)} finite samples with a known pose in {(stop_ns - start_ns) * 1e-9:.3g} s, expected "
            f"{config.min_s:g} s of them."
        )
    _check_still(poses, joints.between(start_ns, stop_ns) if joints is not None else None, config)
    std = rows.std(axis=0, ddof=1)
    minutes = (t - t[0]) / 60e9
    centred = minutes - minutes.mean()
    drift = (centred[:, None] * rows).sum(axis=0) / (centred**2).sum() * minutes[-1]
    for what, got, limit in (
        ("spreads, a standard deviation of", std, config.max_spread * rig.sensor.noise),
        ("drifts by", np.abs(drift), config.max_drift * rig.sensor.noise),
    ):
        worst = int(np.argmax(got / np.maximum(limit, FLOOR)))
        if not got[worst] <= max(limit[worst], FLOOR[worst]):
            unit = raw.signal.units[worst]
            raise CalibrationError(
                f"the reading {what} {got[worst]:.3g} {unit} in {raw.signal.columns[worst]}, expected "
                f"{limit[worst]:.3g} {unit} at most: something touches the tool, or shakes it."
            )
    mount = SensorMount(rig)
    R = mean_rotation(mount.orientation(poses[:, 3:]))
    return Rest(
        start_ns=int(t[0]),
        stop_ns=int(t[-1]) + 1,
        R_base_sensor=R,
        mean=rows.mean(axis=0),
        std=std,
        blocks=blocks_of(rows, period_s),
        samples=len(rows),
    )


def _check_still(poses: Float[np.ndarray, "n 7"], joints: Stream | None, config: RestConfig) -> None:
    R = rotation_of(poses[:, 3:])
    turned_rad = float(np.linalg.norm(log_so3(R[0].T @ R), axis=1).max())
    if not turned_rad <= config.max_turned_rad:
        raise CalibrationError(
            f"the tool turns: got {turned_rad:.3g} rad within it, expected {config.max_turned_rad:g} rad at most."
        )
    if joints is None or not len(joints):
        return
    columns = [i for i, unit in enumerate(joints.signal.units) if unit == "rad/s"]
    fastest = np.abs(joints.data[:, columns]).max(axis=0)
    joint = int(np.argmax(np.nan_to_num(fastest, nan=np.inf)))
    if not fastest[joint] <= config.max_joint_velocity_rad_s:
        raise CalibrationError(
            f"the joints move: got {fastest[joint]:.3g} rad/s in {joints.signal.columns[columns[joint]]}, expected "
            f"{config.max_joint_velocity_rad_s:g} rad/s at most."
        )


def standard_errors(rests: list[Rest]) -> Float[np.ndarray, "k 6"]:
    """Standard deviation of the mean reading of each rest. Shape (k, 6).

    It is told from how means of stretches scatter, over all rests together (see `process.means`).

    Raises:
        CalibrationError: If there are too few of them to tell.
    """
    counts = np.array([len(rest.blocks) for rest in rests])
    freedom = int((counts - 1).sum())
    if freedom < _MIN_BLOCKS:
        raise CalibrationError(
            f"the rests are too short to tell how well their means are known: got {freedom + len(rests)} stretches in "
            f"{len(rests)} rests, expected {_MIN_BLOCKS + len(rests)} at least."
        )
    squares = sum(((rest.blocks - rest.blocks.mean(axis=0)) ** 2).sum(axis=0) for rest in rests)
    return np.maximum(np.sqrt(squares / freedom / counts[:, None]), FLOOR)


def effective_samples(rests: list[Rest]) -> Float[np.ndarray, " 6"]:
    """Share of the samples of a rest that are as good as independent, in the mean over all rests. Shape (6,)."""
    errors = standard_errors(rests)
    variance = np.mean([rest.std**2 for rest in rests], axis=0)
    each = variance / errors**2
    return np.minimum(each / np.array([rest.samples for rest in rests])[:, None], 1.0).mean(axis=0)
