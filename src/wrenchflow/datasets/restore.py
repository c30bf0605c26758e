"""From a data set back to episodes: each observation a stream at the data set's rate, the force at its own.

A window of the last 50 samples of the force goes along with each step. At 20 steps a second these windows lie end to
end, so that the force comes back at 1 kHz, sample for sample; what no window holds is left out, and never made up.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import DatasetError
from wrenchflow.observation import Steps
from wrenchflow.signals import ARM_JOINTS, JOINTS, POSE, TWIST, WRENCH
from wrenchflow.spatial import make_pose, rotation_of_rot6d

SAMPLE_NS = 1_000_000  # Of the force that we record.


def to_episode(steps: Steps, *, sample_ns: int = SAMPLE_NS) -> Episode:
    """An episode from its steps.

    Torques of the joints are not part of a data set, and are NaN. Goals are said when they change. The target of a step
    is stamped when it was to be reached, at the next step.

    Args:
        steps: Of a data set.
        sample_ns: Time between the samples of a force window [ns].

    Returns:
        `tcp_pose`, `tcp_twist`, `joint_states`, `wrench`, `target_pose` and `goal_pose`, in single precision as the
        data set has them, and `meta` with what it said. Steps that are marked as not valid are not part of a stream.

    Raises:
        DatasetError: If windows that overlap say different things of one sample.
    """
    usable = np.logical_and.reduce([np.ones(len(steps), bool), *steps.valid.values()])
    if not usable.any():
        raise DatasetError(f"episode {steps.episode_id} has no step that is marked as valid.")
    of = {name: values[usable].astype(np.float64) for name, values in steps.observations.items()}
    t = steps.t[usable]
    torque = np.full((len(t), ARM_JOINTS), np.nan)
    goal = of["goal_pose"]
    said = np.concatenate([[True], (goal[1:] != goal[:-1]).any(axis=1)])
    t_wrench, wrench = _wrench(steps, usable, sample_ns)
    streams = {
        "tcp_pose": Stream(t, of["tcp_pose"], POSE, "base"),
        "tcp_twist": Stream(t, of["tcp_twist"], TWIST, "base"),
        "joint_states": Stream(t, np.hstack([of["joint_position"], of["joint_velocity"], torque]), JOINTS),
        "wrench": Stream(t_wrench, wrench, WRENCH, "base"),
        "target_pose": _target(steps, usable),
        "goal_pose": Stream(t[said], goal[said], POSE, "base"),
    }
    outcome = "success" if steps.success else "failure"
    meta = {
        "result": {"success": steps.success},
        "operator": steps.operator,
        "restored": {"recording_id": steps.recording_id, "period_ns": steps.period_ns},
        "process": {"config": {"filter": to_mapping(steps.wrench_filter)}},
    }
    end_ns = int(streams["target_pose"].t[-1])
    return Episode(
        id=steps.episode_id,
        task=steps.task,
        streams=streams,
        events=(Event(end_ns, end_ns, outcome),),
        meta=meta,
    )


def _target(steps: Steps, usable: np.ndarray) -> Stream:
    """Targets, at the steps that they were to be reached at; of the last step, a period later."""
    t_next = np.append(steps.t[1:], steps.t[-1] + steps.period_ns)[usable]
    action = steps.actions[usable].astype(np.float64)
    poses = np.array([make_pose(row[:3], rotation_of_rot6d(row[3:])) for row in action])
    # Of the two quaternions of a rotation, the one that observations take.
    poses[:, 3:] *= np.where(poses[:, 4:5] < 0.0, -1.0, 1.0)
    return Stream(t_next, poses, POSE, "base")


def _wrench(
    steps: Steps, usable: np.ndarray, sample_ns: int
) -> tuple[Int64[np.ndarray, " n"], Float[np.ndarray, "n 6"]]:
    """All samples of the force that are known, each once."""
    skew_ns = steps.skew_ns.get("wrench", np.zeros(len(steps), np.int64))
    newest = (steps.t - skew_ns)[usable]
    windows = steps.observations.get("wrench_window")
    if windows is None:
        t, rows = newest, steps.observations["wrench"][usable]
    else:
        length = windows.shape[1]
        t = (newest[:, None] - sample_ns * np.arange(length - 1, -1, -1)).ravel()
        rows = windows[usable].reshape(-1, windows.shape[-1])
    t, first, inverse = np.unique(t, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first][inverse], rows):
        raise DatasetError(
            f"episode {steps.episode_id} has windows that overlap and differ: its force was not sampled every "
            f"{sample_ns * 1e-6:g} ms."
        )
    return t, rows[first].astype(np.float64)


def joined(parts: list[Steps]) -> dict[str, list[Steps]]:
    """Parts by the recording that they are from, in the order of their times."""
    found: dict[str, list[Steps]] = {}
    for part in parts:
        found.setdefault(part.recording_id, []).append(part)
    return {id: sorted(each, key=lambda part: int(part.t[0])) for id, each in found.items()}


def restore(parts: list[Steps], *, sample_ns: int = SAMPLE_NS) -> Episode:
    """An episode from all parts of one recording, which gaps had divided.

    Args:
        parts: Of one recording, in the order of their times.
        sample_ns: Time between the samples of a force window [ns].
    """
    episodes = [to_episode(part, sample_ns=sample_ns) for part in parts]
    streams = {name: _chained([each[name] for each in episodes]) for name in episodes[0].streams}
    return replace(episodes[-1], id=parts[0].recording_id, streams=streams)


def _chained(streams: list[Stream]) -> Stream:
    t = np.concatenate([each.t for each in streams])
    data = np.concatenate([each.data for each in streams])
    # Where parts meet, the target of the last step and a window may reach into the next part.
    t, first = np.unique(t, return_index=True)
    return replace(streams[0], t=t, data=data[first])
