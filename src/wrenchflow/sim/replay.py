"""Drives the simulated arm with the torques of a recording, and says how far it comes to lie from what was recorded."""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchflow.control.records import JOINTS, OBS
from wrenchflow.episode import Episode
from wrenchflow.errors import RecordingError
from wrenchflow.rig import rig_of
from wrenchflow.sim.attempt import generators
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.tasks import make_task
from wrenchflow.sim.tasks.task import Scene


@dataclass(frozen=True, kw_only=True)
class Replay:
    """How far a replay came to lie from its recording.

    Attributes:
        ticks: How many were replayed.
        joint_divergence_rad: Largest difference of a measured joint angle [rad].
        tcp_divergence_m: Largest distance between the measured positions of the TCP [m].
        wrench_divergence_n: Largest difference of a measured force [N].
    """

    ticks: int
    joint_divergence_rad: float
    tcp_divergence_m: float
    wrench_divergence_n: float


def replay(episode: Episode) -> Replay:
    """Set up the scene of a recording again, noise included, and command its torques, tick by tick.

    Nothing is controlled: what the arm does follows from the torques alone. All differences are 0 where simulator and
    model are those of the recording.

    Args:
        episode: Recorded in simulation, in virtual or in real time.

    Raises:
        RecordingError: If it was not, or a tick is missing.
    """
    if "simulator" not in episode.meta or "seed" not in episode.meta:
        raise RecordingError(
            f"episode {episode.id} was not recorded in simulation: it has no 'simulator' and no 'seed'."
        )
    command, joints = episode["joint_command"], episode["joint_states"]
    if len(command) != len(joints) or (np.diff(command.t) != np.diff(command.t)[:1]).any():
        raise RecordingError(f"episode {episode.id} lacks ticks, and what is missing cannot be commanded.")
    rig, task, start = rig_of(episode.meta, episode.id), make_task(episode.task), episode.meta["simulator"]
    model = task.make_model(rig)
    data = mujoco.MjData(model)
    scene = Scene(
        q_start_rad=np.array(start["q_start_rad"]),
        T_base_goal=np.array(start["T_base_goal"]),
        T_base_goal_perceived=episode["goal_pose"].data[0],
    )
    task.place(model, data, scene)
    _, plant_rng, _ = generators(episode.meta["seed"])
    plant = Plant(model, data, rig, Measurement(), plant_rng, capacity_s=0.001)
    obs = np.zeros(1, OBS)
    plant.read(obs)  # As `Plant.begin` does before the first tick.
    q, x, force = np.empty((len(command), JOINTS)), np.empty((len(command), 3)), np.empty((len(command), 3))
    for tick, torque in enumerate(command.data):
        plant.read(obs)
        q[tick], x[tick], force[tick] = obs[0]["q"], obs[0]["x"], obs[0]["wrench"][:3]
        plant.write(torque)
    return Replay(
        ticks=len(command),
        joint_divergence_rad=float(np.abs(q - joints.data[:, :JOINTS]).max()),
        tcp_divergence_m=float(np.linalg.norm(x - episode["tcp_pose"].data[:, :3], axis=1).max()),
        wrench_divergence_n=float(np.abs(force[1:] - episode["wrench_raw"].data[:, :3]).max()),
    )
