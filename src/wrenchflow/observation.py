"""What a policy sees and does at one step: sampled in the same way from a recording and from a running robot."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from wrenchflow import sampling
from wrenchflow.episode import Stream
from wrenchflow.errors import DatasetError, unknown
from wrenchflow.force_filter import FilterConfig
from wrenchflow.signals import ARM_JOINTS, JOINTS, POSE, TWIST, WRENCH
from wrenchflow.spatial import rot6d_of, rotation_of

WINDOW_LENGTH = 50
MEAN_NS = 100_000_000
# How far back an observation looks, the goal apart. See `observe` for what a running robot has to keep.
HISTORY_NS = 150_000_000

# The observations of a step, by name, with the shape of one step's value. All are in the base frame and SI units.
OBSERVATIONS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        "tcp_pose": (7,),  # x y z [m], qw qx qy qz: between the two nearest samples
        "tcp_twist": (6,),  # [m/s, rad/s]: between the two nearest samples
        "joint_position": (7,),  # [rad]: between the two nearest samples
        "joint_velocity": (7,),  # [rad/s]: between the two nearest samples
        "wrench": (6,),  # [N, N.m] about the TCP: the last causally filtered sample
        "wrench_mean": (6,),  # the mean of the filtered samples of the last 100 ms
        "wrench_window": (WINDOW_LENGTH, 6),  # the last 50 filtered samples, oldest first
        "goal_pose": (7,),  # the task's goal as perceived: held since it was last said
    }
)
# A data set may do without: it is most of the bytes.
OPTIONAL = frozenset({"wrench_window"})
ACTION_WIDTH = 9  # target position [m] and first two columns of the target's rotation, in the base frame


@dataclass(frozen=True, eq=False)
class Steps:
    """One episode on the policy's grid: step k is seen at t[k], and its action is the target to be reached at t[k + 1].

    Attributes:
        episode_id: Id of the recording that the steps come from.
        t: Stamps of the steps [ns]. Shape (T,).
        period_ns: Nominal time between steps [ns]. A rate such as 30 Hz has no whole period, and pictures come a little
            early or late, so stamps may be off it.
        observations: By name; `OBSERVATIONS` gives shapes and units. Shape (T, ...).
        actions: Target position [m] and rot6d. Shape (T, 9).
        success: Whether the attempt reached its goal; False where nobody said so.
        wrench_filter: What its wrench went through, and has to go through where a policy that learned from it runs.
        recording_id: The recording that it is from. An episode that a gap divides becomes several, of one recording.
        task: The task that was attempted.
        operator: Who demonstrated; empty where nobody said so.
        skew_ns: How old the newest sample of a stream was at each step [ns], by the stream's name. Shape (T,).
        valid: Whether a stream had the samples that a step needs; where not, its values are those of the last step that
            had. Shape (T,).
        pictures: What each camera saw last at each step, compressed, by the camera's name. T of them.
    """

    episode_id: str
    t: Int64[np.ndarray, " T"]
    period_ns: int
    observations: Mapping[str, Float32[np.ndarray, "T ..."]]
    actions: Float32[np.ndarray, "T 9"]
    success: bool = False
    wrench_filter: FilterConfig = field(default_factory=FilterConfig)
    recording_id: str = ""
    task: str = ""
    operator: str = ""
    skew_ns: Mapping[str, Int64[np.ndarray, " T"]] = field(default_factory=dict)
    valid: Mapping[str, Bool[np.ndarray, " T"]] = field(default_factory=dict)
    pictures: Mapping[str, Sequence[bytes]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "recording_id", self.recording_id or self.episode_id)
        columns = {"observation": self.observations, "skew": self.skew_ns, "validity": self.valid}
        for what, of in (*columns.items(), ("camera", self.pictures)):
            for name, values in of.items():
                if len(values) != len(self.t):
                    raise DatasetError(
                        f"{what} '{name}' of {self.episode_id} has {len(values)} steps, expected {len(self.t)}."
                    )
        if len(self.actions) != len(self.t):
            raise DatasetError(
                f"episode {self.episode_id} has {len(self.actions)} actions, expected {len(self.t)}, one a step."
            )

    def __len__(self) -> int:
        return len(self.t)


def observe(
    streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"], names: Collection[str] = OBSERVATIONS
) -> dict[str, Float32[np.ndarray, "T ..."]]:
    """Sample what a policy sees: the one rule for recordings and for running robots.

    A value is the same, bit for bit, whether it is asked of a whole recording or of the last samples of each stream.
    Those have to reach back to the last sample at or before t - `HISTORY_NS`, or to the start of the stream;
    `goal_pose` back to the last one that was said. Nothing is extrapolated, and nothing bridges a gap of more than
    `sampling.MAX_GAP_NS`.

    A rotation has two quaternions. The one with a positive qx is taken: it depends on nothing but the pose, and it
    flips only where the tool is turned by 180 degrees away from pointing straight down (0, 1, 0, 0), where qw, the
    usual choice, changes sign all the time.

    Args:
        streams: `tcp_pose`, `tcp_twist`, `joint_states`, `wrench` (as `process` adds it) and `goal_pose`; those that
            `names` need.
        t_ns: Times of the steps [ns]. Shape (T,).
        names: Which of `OBSERVATIONS`.

    Returns:
        Values by name, in the order of `OBSERVATIONS`. Shape (T, ...).

    Raises:
        DatasetError: If a stream is missing, does not cover a step, has a gap there, or is not finite.
    """
    for name in names:
        if name not in OBSERVATIONS:
            raise DatasetError(unknown("observation", name, OBSERVATIONS))
    return {name: _single(RULES[name].sample(streams, t_ns), t_ns, name) for name in OBSERVATIONS if name in names}


def actions(
    streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"], t_next_ns: Int64[np.ndarray, " T"]
) -> Float32[np.ndarray, "T 9"]:
    """What was asked for at each step: the last `target_pose` at or before the next one.

    Args:
        streams: With `target_pose`, in the base frame.
        t_ns: Times of the steps [ns]. Shape (T,).
        t_next_ns: Times of the steps that follow [ns]. Shape (T,).

    Returns:
        Position [m] and rot6d of the target. Shape (T, 9).

    Raises:
        DatasetError: If `target_pose` is missing, does not cover a step, has a gap there, or is not finite.
    """
    target = sampling.take(streams, "target_pose", POSE)
    if len(t_next_ns) and t_next_ns[-1] > target.t[-1]:
        raise DatasetError(f"stream 'target_pose' ends at {target.t[-1]} ns, before the action at {t_next_ns[-1]} ns.")
    pose = sampling.latest(target, t_next_ns, "target_pose")
    sampling.refuse_non_poses(pose, t_next_ns, "target_pose")
    action = np.concatenate([pose[:, :3], rot6d_of(rotation_of(pose[:, 3:]))], axis=1)
    return _single(action, t_ns, "action")


def _single(
    values: Float[np.ndarray, "T ..."], t_ns: Int64[np.ndarray, " T"], name: str
) -> Float32[np.ndarray, "T ..."]:
    with np.errstate(over="ignore"):  # What single precision cannot hold becomes infinite, and is refused below.
        single = values.astype(np.float32)
    bad = ~np.isfinite(single).reshape(len(single), -1).all(axis=1)
    if bad.any():
        raise DatasetError(f"'{name}' is not finite at the step at {t_ns[bad][0]} ns.")
    return single


def _one_sign(pose: Float[np.ndarray, "T 7"]) -> Float[np.ndarray, "T 7"]:
    sign = np.where(pose[:, 4:5] < 0.0, -1.0, 1.0)
    return np.concatenate([pose[:, :3], sign * pose[:, 3:]], axis=1)


def _tcp_pose(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 7"]:
    return _one_sign(sampling.pose(sampling.take(streams, "tcp_pose", POSE), t_ns, "tcp_pose"))


def _tcp_twist(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 6"]:
    return sampling.linear(sampling.take(streams, "tcp_twist", TWIST), t_ns, "tcp_twist")


def _joint_position(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 7"]:
    joints = sampling.take(streams, "joint_states", JOINTS)
    return sampling.linear(joints, t_ns, "joint_states")[:, :ARM_JOINTS]


def _joint_velocity(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 7"]:
    joints = sampling.take(streams, "joint_states", JOINTS)
    return sampling.linear(joints, t_ns, "joint_states")[:, ARM_JOINTS : 2 * ARM_JOINTS]


def _wrench(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 6"]:
    return sampling.latest(sampling.take(streams, "wrench", WRENCH), t_ns, "wrench")


def _wrench_mean(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 6"]:
    return sampling.mean(sampling.take(streams, "wrench", WRENCH), t_ns, "wrench", MEAN_NS)


def _wrench_window(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T w 6"]:
    return sampling.window(sampling.take(streams, "wrench", WRENCH), t_ns, "wrench", WINDOW_LENGTH, HISTORY_NS)


def _goal_pose(streams: Mapping[str, Stream], t_ns: Int64[np.ndarray, " T"]) -> Float[np.ndarray, "T 7"]:
    goal = sampling.held(sampling.take(streams, "goal_pose", POSE), t_ns, "goal_pose")
    sampling.refuse_non_poses(goal, t_ns, "goal_pose")
    return _one_sign(goal)


@dataclass(frozen=True, kw_only=True)
class Rule:
    """How an observation comes from the samples of a stream.

    Attributes:
        stream: The stream.
        method: `linear` and `slerp` between the two nearest samples; `latest`, `mean` and `window` of the last ones at
            or before the step; `hold` for what is said on change.
        reach_ns: How far back it looks [ns].
        sample: The values of all steps at once.
    """

    stream: str
    method: Literal["linear", "slerp", "latest", "mean", "window", "hold"]
    reach_ns: int = 0
    sample: Callable[[Mapping[str, Stream], Int64[np.ndarray, " T"]], Float[np.ndarray, "T ..."]]

    @property
    def is_causal(self) -> bool:
        """Whether it uses nothing from after the step; between samples it uses the one that follows."""
        return self.method not in ("linear", "slerp")


RULES: Mapping[str, Rule] = MappingProxyType(
    {
        "tcp_pose": Rule(stream="tcp_pose", method="slerp", sample=_tcp_pose),
        "tcp_twist": Rule(stream="tcp_twist", method="linear", sample=_tcp_twist),
        "joint_position": Rule(stream="joint_states", method="linear", sample=_joint_position),
        "joint_velocity": Rule(stream="joint_states", method="linear", sample=_joint_velocity),
        "wrench": Rule(stream="wrench", method="latest", sample=_wrench),
        "wrench_mean": Rule(stream="wrench", method="mean", reach_ns=MEAN_NS, sample=_wrench_mean),
        "wrench_window": Rule(stream="wrench", method="window", reach_ns=HISTORY_NS, sample=_wrench_window),
        "goal_pose": Rule(stream="goal_pose", method="hold", sample=_goal_pose),
    }
)
