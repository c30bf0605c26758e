"""What the simulator knows of contact: the force between tool and scene at each tick of a recording."""

import mujoco
import numpy as np

from wrenchflow.config import from_mapping
from wrenchflow.control.records import OBS
from wrenchflow.episode import Episode
from wrenchflow.rig import rig_of
from wrenchflow.sim.attempt import MODEL, generators
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.state import model_of, set_state

SENSOR_SITE = "sensor"


def true_contact(episode: Episode) -> tuple[np.ndarray, np.ndarray]:
    """Replay a simulated recording, and ask the simulator what touches.

    Args:
        episode: Recorded in simulation.

    Returns:
        Stamps [ns], shape (n,), and the norm of the force between the tool and everything else [N], shape (n,), which
        is 0 without a contact.
    """
    start = episode.meta["simulator"]
    model = model_of(episode.attachments[MODEL].data)
    data = mujoco.MjData(model)
    _, plant_rng, *_ = generators(episode.meta["seed"])
    measurement = from_mapping(Measurement, start["measurement"], where="measurement")
    plant = Plant(model, data, rig_of(episode.meta, episode.id), measurement, plant_rng, capacity_s=0.001)
    set_state(model, data, np.array(start["state"], float))
    obs = np.zeros(1, OBS)
    plant.read(obs)
    tool = tool_geoms(model)
    # A copy is asked, for asking changes where the solver begins.
    copy, force_n, one = mujoco.MjData(model), np.zeros(len(episode["joint_command"])), np.zeros(6)
    for tick, torque in enumerate(episode["joint_command"].data):
        plant.read(obs)
        mujoco.mj_copyData(copy, model, data)
        mujoco.mj_forward(model, copy)
        total_n = np.zeros(3)
        for i in range(copy.ncon):
            contact = copy.contact[i]
            if tool[contact.geom1] != tool[contact.geom2]:
                mujoco.mj_contactForce(model, copy, i, one)
                sense = 1.0 if tool[contact.geom2] else -1.0
                total_n += sense * contact.frame.reshape(3, 3).T @ one[:3]
        force_n[tick] = np.linalg.norm(total_n)
        plant.write(torque)
    return episode["joint_command"].t, force_n


def tool_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Whether each geom hangs below the wrist sensor."""
    body = model.site_bodyid[model.site(SENSOR_SITE).id]
    below = np.zeros(model.nbody, bool)
    below[body] = True
    for child in range(body + 1, model.nbody):
        below[child] = below[model.body_parentid[child]]
    return below[model.geom_bodyid]
