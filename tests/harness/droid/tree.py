"""DROID trees as the real ones lie on a disk: every group, type and attribute of the raw release, in plausible motion.

Torques are what holds the arm up, plus a bias of the sensors, noise, and a wrench that is planted where the arm
touches, so that an analysis has something to find. What is known to be wrong with real trees can be planted too.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.external_wrench import holding_torque
from wrenchflow.kinematics import jacobians

LABS = ("AUTOLab", "CLVR", "IRIS", "TRI")
TASKS = (
    "Put the marker in the cup",
    "Insert the plug into the socket",
    "Wipe the table with the towel",
    "Press the button of the coffee machine",
    "Close the drawer",
)
CAMERAS = ("22008760", "24400334", "18026681")
RATE_HZ = 15.0
_READY_RAD = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.7, 0.8])
_FLANGE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_START_MS = 1_690_000_000_000


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong with an episode.

    Attributes:
        without_metadata: No file beside the trajectory.
        without_optional: None of the keys that not every release has.
        copy_of: The number of the episode whose joints it repeats; -1 for none.
        slow: Steps that take 200 ms.
        skipped: Steps whose action is skipped.
        not_finite: Torques that are NaN.
        truncated: The file is cut off in its middle.
    """

    without_metadata: bool = False
    without_optional: bool = False
    copy_of: int = -1
    slow: int = 0
    skipped: int = 0
    not_finite: int = 0
    truncated: bool = False


def motion(number: int, steps: int) -> np.ndarray:
    """Joint angles [rad] of an episode: smooth, at rest for the first second. Shape (T, 7)."""
    rng = np.random.default_rng([number, 1])
    knots = _READY_RAD + np.cumsum(rng.normal(0.0, 0.12, (8, 7)), axis=0)
    t = np.clip((np.arange(steps) - RATE_HZ) / max(steps - RATE_HZ, 1.0), 0.0, 1.0) * (len(knots) - 1)
    i = np.minimum(t.astype(int), len(knots) - 2)
    s = (t - i)[:, None]
    s = s * s * (3.0 - 2.0 * s)
    return knots[i] * (1.0 - s) + knots[i + 1] * s


def touched(steps: int) -> slice:
    """The steps at which the arm touches something."""
    return slice(round(0.55 * steps), round(0.7 * steps))


def write_episode(root: Path, number: int, *, steps: int = 250, faults: Faults | None = None) -> Path:
    """Write one; returns its folder."""
    faults = faults or Faults()
    rng = np.random.default_rng([number, 2])
    lab, success = LABS[number % len(LABS)], number % 5 != 4
    user = f"{lab} collector {number // len(LABS) % 3}"
    day = f"2023-07-{1 + number % 28:02d}"
    folder = root / lab / ("success" if success else "failure") / day / f"Mon_Jul__{number:06d}"
    folder.mkdir(parents=True)
    (folder / "recordings" / "MP4").mkdir(parents=True)
    q = motion(number if faults.copy_of < 0 else faults.copy_of, steps)
    task = TASKS[number % len(TASKS)]
    said = {
        "current_task": task,
        "user": user,
        "building": f"{lab} building",
        "scene_id": 1000 + number % 11,
        "success": success,
    }
    path = folder / "trajectory.h5"
    with h5py.File(path, "w") as file:
        _attributes(file, said, day)
        for name, values in _columns(rng, q, faults).items():
            file.create_dataset(name, data=values)
    if faults.truncated:
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
    if not faults.without_metadata:
        _write_metadata(folder, number, said, lab, steps)
    return folder


def write_tree(root: Path, count: int, *, steps: int = 250, faults: dict[int, Faults] | None = None) -> Path:
    """Write a tree of that many episodes."""
    for number in range(count):
        write_episode(root, number, steps=steps + number % 7, faults=(faults or {}).get(number))
    return root


def _attributes(file: h5py.File, said: dict[str, object], day: str) -> None:
    attributes = {**said, "time": day, "robot_serial_number": "panda-295341-1325480", "version_number": 1.1}
    attributes |= {"failure": not said["success"], "movement_enabled": True, "controller_on": True}
    for name, value in attributes.items():
        file.attrs[name] = value


def _write_metadata(folder: Path, number: int, said: dict[str, object], lab: str, steps: int) -> None:
    uuid = f"{lab}+{number:08x}+2023-07-01-00h-00m-{number:06d}s"
    metadata = {
        **said,
        "uuid": uuid,
        "lab": lab,
        "user_id": f"{number:08x}",
        "date": "2023-07-01",
        "timestamp": f"2023-07-01-00h-00m-{number:06d}s",
        "hdf5_path": str(folder.name),
        "robot_serial": "panda-295341-1325480",
        "droid_version": 1.1,
        "trajectory_length": steps,
        **{
            f"{name}_serial": serial
            for name, serial in zip(("wrist_cam", "ext1_cam", "ext2_cam"), CAMERAS, strict=True)
        },
    }
    (folder / f"metadata_{uuid}.json").write_text(json.dumps(metadata))


def _columns(rng: np.random.Generator, q: np.ndarray, faults: Faults) -> dict[str, np.ndarray]:
    steps = len(q)
    position, jacobian = jacobians(q, _FLANGE)
    planted = np.zeros((steps, 6))
    planted[touched(steps), 2] = -rng.uniform(15.0, 30.0)
    torque = holding_torque(q, AnalysisConfig()) + np.einsum("nij,ni->nj", jacobian, planted)
    torque += rng.normal(0.0, 0.3, 7) + rng.normal(0.0, [0.5] * 4 + [0.2] * 3, (steps, 7))
    torque[20 : 20 + faults.not_finite, 2] = np.nan
    pose = np.hstack([position, rng.normal(0.0, 0.02, (steps, 3)) + [np.pi, 0.0, 0.0]])
    velocity = np.gradient(q, axis=0) * RATE_HZ
    gripper = (np.arange(steps) > 0.5 * steps).astype(np.float64)
    took = np.full(steps, 66.667)
    took[steps // 3 : steps // 3 + faults.slow] = 200.0
    begun = _START_MS + np.concatenate([[0.0], np.cumsum(took)[:-1]]).astype(np.int64)
    read = begun + 2
    skip = np.zeros(steps, bool)
    skip[5 : 5 + faults.skipped] = True
    on = np.ones(steps, bool)
    state = {
        "cartesian_position": pose,
        "gripper_position": gripper,
        "joint_positions": q,
        "joint_velocities": velocity,
        "joint_torques_computed": 0.1 * torque,
        "prev_joint_torques_computed": 0.1 * torque,
        "prev_joint_torques_computed_safened": 0.1 * torque,
        "motor_torques_measured": torque,
        "prev_controller_latency_ms": rng.gamma(4.0, 0.5, steps),
        "prev_command_successful": on,
    }
    found = {f"observation/robot_state/{name}": values for name, values in state.items()}
    found |= {f"action/robot_state/{name}": values for name, values in state.items()}
    for name in ("success", "failure", "movement_enabled", "controller_on"):
        found[f"observation/controller_info/{name}"] = on if name in ("movement_enabled", "controller_on") else ~on
    stamp = "observation/timestamp"
    found[f"{stamp}/skip_action"] = skip
    robot_ns = (read - _START_MS) * 1_000_000 + (np.arange(steps) * 3e3).astype(np.int64) + 7_000_000_000
    found[f"{stamp}/robot_state/read_start"] = read
    found[f"{stamp}/robot_state/read_end"] = read + rng.integers(1, 4, steps)
    found[f"{stamp}/robot_state/robot_timestamp_seconds"] = robot_ns // 1_000_000_000
    found[f"{stamp}/robot_state/robot_timestamp_nanos"] = robot_ns % 1_000_000_000
    for name, after in (("step_start", 0), ("policy_start", 20), ("sleep_start", 25), ("control_start", 55)):
        found[f"{stamp}/control/{name}"] = begun + after
    found[f"{stamp}/control/step_end"] = begun + 60 + rng.integers(0, 6, steps)
    for i, serial in enumerate(CAMERAS):
        captured = read - 30 - 5 * i + rng.integers(-3, 4, steps)
        for name, after in (("read_start", 20), ("read_end", 28), ("frame_received", 15), ("estimated_capture", 0)):
            found[f"{stamp}/cameras/{serial}_{name}"] = captured + after
        found[f"observation/camera_type/{serial}"] = np.full(steps, min(i, 1))
        for side in ("left", "right"):
            found[f"observation/camera_extrinsics/{serial}_{side}"] = np.tile(rng.normal(0.0, 0.5, 6), (steps, 1))
            found[f"observation/camera_intrinsics/{serial}_{side}"] = np.tile(np.eye(3), (steps, 1, 1))
    action = {
        "cartesian_position": pose,
        "cartesian_velocity": np.clip(np.gradient(pose, axis=0) * 3.0, -1.0, 1.0),
        "joint_position": q,
        "joint_velocity": np.clip(velocity, -1.0, 1.0),
        "gripper_position": gripper,
        "gripper_velocity": np.zeros(steps),
        "target_cartesian_position": pose,
        "target_gripper_position": gripper,
    }
    found |= {f"action/{name}": values for name, values in action.items()}
    if faults.without_optional:
        optional = (
            "target_",
            "gripper_velocity",
            "camera_intrinsics",
            "controller_info",
            "motor_torques",
            "skip_action",
        )
        found = {name: values for name, values in found.items() if not any(part in name for part in optional)}
    return found


def columns_read() -> Iterator[str]:
    """What an analysis reads of an episode, by name."""
    state = "observation/robot_state"
    for name in ("joint_positions", "cartesian_position", "motor_torques_measured", "prev_controller_latency_ms"):
        yield f"{state}/{name}"
    yield f"{state}/prev_command_successful"
    yield "action/cartesian_velocity"
    stamp = "observation/timestamp"
    yield f"{stamp}/skip_action"
    for name in ("read_start", "read_end", "robot_timestamp_seconds", "robot_timestamp_nanos"):
        yield f"{stamp}/robot_state/{name}"
    for name in ("step_start", "step_end"):
        yield f"{stamp}/control/{name}"
    for serial in CAMERAS:
        yield f"{stamp}/cameras/{serial}_estimated_capture"
