"""Drives the simulated arm with the torques of a recording, and says how far it comes to lie from what was recorded."""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchflow.config import from_mapping
from wrenchflow.control.records import JOINTS, OBS
from wrenchflow.episode import Episode
from wrenchflow.errors import ControlError, RecordingError
from wrenchflow.rig import rig_of
from wrenchflow.sim.attempt import MODEL, generators
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.state import model_of, set_state, state_size


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
    """Set up a recording's own model and state again, noise included, and command its torques, tick by tick.

    Nothing is controlled: what the arm does follows from the torques alone. All differences are 0 where the simulator
    is that of the recording.

    Args:
        episode: Recorded in simulation, in virtual or in real time.

    Raises:
        RecordingError: If it was not, or a tick is missing.
    """
    start = episode.meta.get("simulator", {})
    if "state" not in start or "seed" not in episode.meta or MODEL not in episode.attachments:
        raise RecordingError(
            f"episode {episode.id} was not recorded in simulation: it lacks the model, the state or the seed."
        )
    command, joints = episode["joint_command"], episode["joint_states"]
    if len(command) != len(joints) or (np.diff(command.t) != np.diff(command.t)[:1]).any():
        raise RecordingError(f"episode {episode.id} lacks ticks, and what is missing cannot be commanded.")
    try:
        model = model_of(episode.attachments[MODEL].data)
    except ControlError as error:
        raise RecordingError(
            f"'{MODEL}' in episode {episode.id}, recorded with MuJoCo {start.get('mujoco', '?')}, is {error}"
        ) from error
    state = np.array(start["state"], float)
    if state.shape != (state_size(model),):
        raise RecordingError(
            f"episode {episode.id} has a state of {state.size} numbers, and its model takes {state_size(model)}."
        )
    data = mujoco.MjData(model)
    _, plant_rng, *_ = generators(episode.meta["seed"])
    measurement = from_mapping(Measurement, start["measurement"], where=f"{episode.id}: measurement")
    plant = Plant(model, data, rig_of(episode.meta, episode.id), measurement, plant_rng, capacity_s=0.001)
    set_state(model, data, state)
    obs = np.zeros(1, OBS)
    plant.read(obs)  # As `Plant.begin` does before the first tick: it draws numbers, and the sensor's filter begins.
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
