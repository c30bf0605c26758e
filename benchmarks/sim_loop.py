"""Control ticks a second against bare `mj_step` of the same model in the same state: in batch, and tick by tick.

The batch side is `Plant.advance` (sensor and joint noise, control, limits, a row stored a tick); the other one is the
`Robot` protocol, unpaced: `read`, `Controller.tick`, the row, `write`. Before each block the bare side takes over the
state of the simulation, so that both step through the same contacts; its torque stays that of the last tick. Run it as
`python benchmarks/sim_loop.py`.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import mujoco
import numpy as np

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.episode import Episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import load_rig
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.streams import streams_of
from wrenchflow.sim.tasks import make_task
from wrenchflow.sim.tasks.task import make_model

BLOCK_TICKS = 200
BLOCKS = 40
PRESS_N = 8.0
GOALS = {"batch": 0.85, "protocol": 0.6}
CLOCKS = {"process": time.process_time, "wall": time.perf_counter}


def scene(pressed: bool) -> tuple[Plant, Controller]:
    """A plant and its controller at rest: 20 mm above the block, or pressed on it beside the hole."""
    rig, task, impedance = load_rig("panda_peg"), make_task("peg-insertion"), Impedance()
    model, rng = make_model(task, rig), np.random.default_rng(0)
    drawn, data = task.draw(model, rng), mujoco.MjData(model)
    task.place(model, data, drawn)
    plant = Plant(model, data, rig, Measurement(), rng, capacity_s=60.0)
    controller = Controller(rig, ControlConfig())
    controller.set_contact_zone(*task.contact_zone(drawn))
    plant.begin(controller, impedance)
    above, down = drawn.T_base_goal.copy(), drawn.T_base_goal.copy()
    above[:3] += [0.003, 0.0, 0.005]
    down[:3] += [0.003, 0.0, -PRESS_N / impedance.translation_n_m]
    controller.ask(controller.target_pose, above, ticks=1500, impedance=impedance)
    plant.advance(controller, 3000)
    if pressed:
        controller.ask(above, down, ticks=1500, impedance=impedance)
        plant.advance(controller, 3000)
    return plant, controller


def batch(plant: Plant, controller: Controller, ticks: int) -> None:
    """All in one compiled loop."""
    plant.advance(controller, ticks)


def protocol(plant: Plant, controller: Controller, ticks: int) -> None:
    """As a real arm is driven, without waiting."""
    for _ in range(ticks):
        plant.read(controller.obs)
        torque = controller.tick()
        plant.record(controller)
        plant.write(torque)


def bare(model: mujoco.MjModel, data: mujoco.MjData, ticks: int) -> None:
    """Nothing but physics, from Python."""
    for _ in range(ticks):
        mujoco.mj_step(model, data)


def seconds(work: Callable[[], None]) -> dict[str, float]:
    """Time that one call takes, by each clock."""
    start = {name: clock() for name, clock in CLOCKS.items()}
    work()
    return {name: clock() - start[name] for name, clock in CLOCKS.items()}


def measure(name: str, side: Callable[[Plant, Controller, int], None], pressed: bool) -> None:
    """Time blocks of `side` and of bare steps in turn, and print how they compare."""
    plant, controller = scene(pressed)
    data = mujoco.MjData(plant.model)
    ours: list[dict[str, float]] = []
    theirs: list[dict[str, float]] = []
    for block in range(BLOCKS + 2):  # The first two warm up.
        mujoco.mj_copyData(data, plant.model, plant.data)
        pair: list[Callable[[], None]] = [
            lambda: side(plant, controller, BLOCK_TICKS),
            lambda: bare(plant.model, data, BLOCK_TICKS),
        ]
        order = (0, 1) if block % 2 else (1, 0)
        took = {i: seconds(pair[i]) for i in order}
        if block >= 2:
            ours.append(took[0])
            theirs.append(took[1])
        if not bool(data.ncon) == bool(plant.data.ncon) == pressed:
            raise SystemExit("the two sides did not step through the same contacts.")
    place = f"pressed with {pressing_force_n(plant):.1f} N, {plant.data.ncon} contacts" if pressed else "free space"
    for clock in CLOCKS:
        ratio = sorted(b[clock] / a[clock] for a, b in zip(ours, theirs, strict=True))
        us = [median(t[clock] for t in times) / BLOCK_TICKS * 1e6 for times in (ours, theirs)]
        print(
            f"{name:9} {place:32} {clock:8} {us[0]:6.2f} us a tick, bare {us[1]:6.2f} us: {median(ratio):5.2f} of bare "
            f"({ratio[len(ratio) // 10]:.2f} to {ratio[-1 - len(ratio) // 10]:.2f}; goal {GOALS[name]})"
        )


def pressing_force_n(plant: Plant) -> float:
    """Vertical force between peg and block, the sum over the contacts [N]."""
    force, total = np.zeros(6), 0.0
    for i in range(plant.data.ncon):
        mujoco.mj_contactForce(plant.model, plant.data, i, force)
        total += (plant.data.contact[i].frame.reshape(3, 3).T @ force[:3])[2]
    return abs(total)


def measure_writing() -> None:
    """Encoding and compression of the rows, which collection pays once an episode."""
    plant, _ = scene(True)
    took = []
    with tempfile.TemporaryDirectory() as folder:
        for repeat in range(6):
            whole = Episode("bench", "none", streams_of(plant.recorded))
            took.append(seconds(lambda path=Path(folder, f"{repeat}.mcap"), whole=whole: write_episode(path, whole)))
    us = median(t["process"] for t in took[1:]) / plant.count * 1e6
    print(f"writing   {plant.count} rows of {len(streams_of(plant.recorded))} topics: {us:.2f} us a tick")


def main() -> None:
    """Measure both ways in both places."""
    for pressed in (True, False):
        measure("batch", batch, pressed)
        measure("protocol", protocol, pressed)
    measure_writing()
    if "torch" in sys.modules:
        raise SystemExit("torch was imported, which no control process needs.")


if __name__ == "__main__":
    main()
