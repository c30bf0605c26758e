"""robosuite in a process of its own: asked in lines of JSON, it answers in lines of JSON. `collect_rate.py` starts it.

Nothing of wrenchflow is imported here, nor can it be: the environment has another MuJoCo and another numpy.
"""

import json
import os
import sys
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import robosuite
from robosuite import macros
from robosuite.controllers import load_composite_controller_config

from bare_steps import BareScene, SceneLog, now_s

TIMESTEP_S = 0.001
# What the hand is brought to, a site or a body, for each task.
GRASPED = {"Lift": "cube_main", "NutAssemblySquare": "SquareNut_handle_site"}
# The hand goes above the object, down to it, closes, lifts it and puts it down: end [s], height above it [m], gripper.
# Of an object that is held the height stays, so the hand goes on upwards or downwards until the phase ends.
MOTION = ((1.5, 0.08, -1.0), (3.0, 0.0, -1.0), (4.0, 0.0, 1.0), (5.0, 0.1, 1.0), (6.0, -0.02, 1.0), (8.0, -0.02, -1.0))
DELTA_M = 0.05  # What an action of 1 asks for.
NOISE = 0.05

macros.SIMULATION_TIMESTEP = TIMESTEP_S  # Read when an environment is made; the class has no argument for it.


class Peer:
    """One task at one rate of commands, with the controller that robosuite gives a Panda: OSC_POSE."""

    def __init__(self, task: str, rate_hz: int) -> None:
        """Make it, and take one step: it compiles what robosuite compiles."""
        controller = load_composite_controller_config(robot="Panda")
        arm = controller["body_parts"]["right"]["type"]
        self._env = robosuite.make(
            task,
            robots="Panda",
            controller_configs=controller,
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            control_freq=rate_hz,
            ignore_done=True,
            hard_reset=False,  # Nothing is compiled anew between episodes.
            seed=0,
        )
        self._task, self._rate_hz = task, rate_hz
        self._rng = np.random.default_rng(0)
        model = self._env.sim.model._model
        if model.opt.timestep != TIMESTEP_S or self._env.model_timestep != TIMESTEP_S or arm != "OSC_POSE":
            raise SystemExit(f"{task} steps {model.opt.timestep} s with {arm}, expected {TIMESTEP_S} s with OSC_POSE.")
        self._env.reset()
        self._env.step(np.zeros(self._env.action_dim))

    def episode(self) -> list[float]:
        """Steps in a second of an episode from a reset on; only what `env.step` takes is counted."""
        self._env.reset()
        data = self._env.sim.data._data
        first_s, took_s = data.time, np.zeros(2)
        for period in range(round(MOTION[-1][0] * self._rate_hz)):
            action = self._action(period / self._rate_hz)
            before_s = now_s()
            self._env.step(action)
            took_s += now_s() - before_s
        return (round((data.time - first_s) / TIMESTEP_S) / took_s).tolist()

    def save(self, path: Path) -> float:
        """Save an episode as a scene for bare steps; the share of its steps in which the gripper touches something."""
        self._env.reset()
        sim = self._env.sim
        log, touching = SceneLog(), []
        step2 = sim.step2

        def listen() -> None:
            log.note(sim.data._data)
            step2()
            touching.append(self._touches())

        sim.step2 = listen
        for period in range(round(MOTION[-1][0] * self._rate_hz)):
            self._env.step(self._action(period / self._rate_hz))
        del sim.step2
        log.save(path, sim.model.get_xml())
        return float(np.mean(touching))

    def _action(self, time_s: float) -> np.ndarray:
        sim = self._env.sim
        height_m, gripper = next(row[1:] for row in MOTION if time_s < row[0])
        name = GRASPED[self._task]
        place = sim.data.get_site_xpos(name) if name.endswith("_site") else sim.data.get_body_xpos(name)
        hand = sim.data.get_site_xpos("gripper0_right_grip_site")
        action = self._rng.uniform(-NOISE, NOISE, self._env.action_dim)
        action[:3] += (place + [0.0, 0.0, height_m] - hand) / DELTA_M
        action[-1] = gripper
        return np.clip(action, -1.0, 1.0)

    def _touches(self) -> bool:
        data, model = self._env.sim.data._data, self._env.sim.model._model
        for contact in data.contact:
            hands = [model.geom(geom).name.startswith("gripper0") for geom in (contact.geom1, contact.geom2)]
            if hands[0] != hands[1]:
                return True
        return False


peer, bare_scene = cache(Peer), cache(BareScene)


def answer(asked: dict) -> object:
    """What is asked for: `versions`, `episode`, `save`, `contacts` or `bare`."""
    match asked["what"]:
        case "versions":
            return {"robosuite": robosuite.__version__, "MuJoCo": mujoco.__version__, "numpy": np.__version__}
        case "episode":
            return peer(asked["task"], asked["rate_hz"]).episode()
        case "save":
            return peer(asked["task"], asked["rate_hz"]).save(Path(asked["path"]))
        case "contacts":
            return bare_scene(Path(asked["path"])).contacts()
        case "bare":
            return bare_scene(Path(asked["path"])).steps_per_s()
        case other:
            raise SystemExit(f"asked for {other!r}, which is unknown.")


def main() -> None:
    """Answer until nobody asks; what robosuite prints goes to stderr."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        answers.write(json.dumps(answer(json.loads(line))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
