"""Simulation steps a second of emulated collection, recording on, against robosuite's OSC_POSE at 1 ms, on one core.

Ours is the whole of an attempt: drawing the scene, tare, operator, device, 1 kHz control with its safety layer, rows in
a black box, the file. robosuite's is `env.step` alone, of a Panda that grasps and lifts, without pictures, resets or
recording, in an environment of its own, which is made where `--env` says. Bare `mj_step` of the same scenes, in both
versions of MuJoCo, tells what the ratio is made of. Run it as
`python benchmarks/collect_rate.py [--task NAME] [--env FOLDER]`.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # For this process and for robosuite's; numpy looks when it is imported.

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from bare_steps import BareScene, SceneLog, now_s
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.control.records import JOINTS
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import MJCF, MODEL
from wrenchflow.sim.state import model_of, set_state
from wrenchflow.sim.streams import ROWS

TASKS, RATES_HZ = ("Lift", "NutAssemblySquare"), (20, 200)
SCENES = ("ours", *TASKS)
# So many rounds, so many of our episodes in each (robosuite's is one of 8 s), and so many of each bare run.
ROUNDS, EPISODES, BARE_RUNS = 5, 4, 4
GOAL = 12.0
VERSIONS = {"robosuite": "1.5.2", "MuJoCo": "3.9.0", "numpy": "1.26.4"}
# What robosuite imports here; what else it declares is for keyboards and humanoids, and wants a compiler.
PACKAGES = (
    f"mujoco=={VERSIONS['MuJoCo']}",
    f"numpy=={VERSIONS['numpy']}",
    "numba==0.68.1",
    "scipy==1.17.1",
    "opencv-python-headless==4.11.0.86",
    "pillow==12.3.0",
    "termcolor==3.3.0",
    "tqdm==4.70.1",
)


def ours(index: int, folder: Path, config: CollectConfig) -> tuple[int, Path]:
    """One episode of emulated collection into a file, as `collect_folder` does it in one process.

    Returns:
        Steps of the simulation that are in the file, and the file.
    """
    path = folder / f"{index:04d}.mcap"
    with BlackBox(folder / "boxes", ROWS, id=path.stem, task=config.task, meta={}) as box:
        episode = demonstrate(index, config, box=box)
        write_episode(path, episode, config.compression)
    return len(episode["tcp_pose"]), path


def our_steps_per_s(first: int, folder: Path, config: CollectConfig) -> np.ndarray:
    """Steps in a second over `EPISODES` episodes, by wall and process time. Shape (2,)."""
    start_s = now_s()
    steps = sum(ours(index, folder, config)[0] for index in range(first, first + EPISODES))
    return steps / (now_s() - start_s)


def save_ours(path: Path, recorded: Path) -> None:
    """A recorded episode as a scene for bare steps: its model, its start, its torques."""
    episode = read_episode(recorded)
    model = model_of(episode.attachments[MODEL].data)
    data = mujoco.MjData(model)
    set_state(model, data, np.array(episode.meta["simulator"]["state"], float))
    log = SceneLog()
    for torque in episode["joint_command"].data:
        data.ctrl[:JOINTS] = torque
        log.note(data)
        mujoco.mj_step(model, data)
    log.save(path, episode.attachments[MJCF].data.decode())


class Peer:
    """robosuite in its own process and environment; it works only while it is asked something."""

    def __init__(self, folder: Path) -> None:
        """Make the environment if it is not there, and start."""
        if folder.resolve() == Path(sys.prefix).resolve():
            raise SystemExit("robosuite's environment has to be another one than this, whose MuJoCo it would replace.")
        python = folder / "bin" / "python"
        if not python.exists():
            make_environment(folder)
        script = Path(__file__).with_name("robosuite_peer.py")
        self._log = folder / "robosuite.log"
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [python, "-W", "ignore", script],
                cwd=folder,
                env=variables,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        versions = self.ask("versions")
        if versions != VERSIONS:
            raise SystemExit(f"'{folder}' has {versions}, expected {VERSIONS}; remove it, and it is made again.")

    def ask(self, what: str, **details: Any) -> Any:
        """What robosuite's process answers to a question of `robosuite_peer.answer`."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        if self._process.poll() is None:
            self._process.stdin.write(json.dumps({"what": what, **details}) + "\n")
            self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"robosuite's process has ended; '{self._log}' says why. Its environment can be removed.")
        return json.loads(line)

    def close(self) -> None:
        """Let it end, which it does when nobody can ask any more."""
        self._process.communicate()


def make_environment(folder: Path) -> None:
    """Install robosuite into an environment of its own, with the interpreter that runs this."""
    uv = shutil.which("uv")
    if uv is None:
        raise SystemExit("uv is not on the path, and nothing else here makes environments: `pip install uv`.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Not from within the project, whose pins would hold for this environment too.
    elsewhere = [uv, "--quiet", "--directory", str(folder.parent)]
    install = [*elsewhere, "pip", "install", "--python", str(folder)]
    subprocess.run([*elsewhere, "venv", "--python", sys.executable, str(folder)], check=True)
    subprocess.run([*install, *PACKAGES], check=True)
    subprocess.run([*install, "--no-deps", f"robosuite=={VERSIONS['robosuite']}"], check=True)


def stay_on_one_core() -> str:
    """Keep this process and those that it starts on one core, where the system can; says which."""
    if not hasattr(os, "sched_setaffinity"):
        return "wherever the system puts it"
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return f"on core {core}"


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was measured.

    Attributes:
        rates: Steps in a second of each side, by round and by wall and process time. Shape (rounds, 2) each.
        contacts: Mean number of contacts in each scene when bare steps run it, in robosuite's MuJoCo and in ours.
        touching: Share of the steps in which robosuite's gripper touches something, for each task.
    """

    rates: dict[str, np.ndarray]
    contacts: dict[str, tuple[float, float]]
    touching: dict[str, float]


def measure(peer: Peer, folder: Path, rounds: int, config: CollectConfig) -> Measured:
    """Let all sides run in turn, round by round."""
    _, recorded = ours(10_000, folder, config)  # The warm-up one.
    paths = {name: folder / name for name in SCENES}
    save_ours(paths["ours"], recorded)
    touching = {task: peer.ask("save", task=task, rate_hz=RATES_HZ[0], path=str(paths[task])) for task in TASKS}
    bare = {name: BareScene(path) for name, path in paths.items()}
    contacts = {name: (peer.ask("contacts", path=str(paths[name])), bare[name].contacts()) for name in SCENES}
    for name, (old, new) in contacts.items():
        seen, recorded = new if name == "ours" else old, bare[name].recorded_contacts
        if abs(seen - recorded) > 0.05 * recorded:
            raise SystemExit(f"bare steps of {name} had {seen:.1f} contacts, and what was recorded {recorded:.1f}.")
    sides: dict[str, Callable[[int], Any]] = {"ours": lambda k: our_steps_per_s(k * EPISODES, folder, config)}
    for task, rate_hz in product(TASKS, RATES_HZ):
        sides[f"{task} {rate_hz}"] = lambda k, t=task, r=rate_hz: peer.ask("episode", task=t, rate_hz=r)
        sides[f"{task} {rate_hz}"](0)  # Made and compiled before it is timed.
    in_turn = list(sides)
    for name in SCENES:
        sides[f"old {name}"] = lambda k, p=str(paths[name]): peer.ask("bare", path=p)
        sides[f"new {name}"] = lambda k, n=name: bare[n].steps_per_s()
        in_turn += [f"old {name}", f"new {name}"] * BARE_RUNS
    rates: dict[str, list] = {name: [] for name in sides}
    for k in range(rounds):
        took: dict[str, list] = {name: [] for name in sides}
        # Every second round goes the other way round.
        for name in in_turn[:: -1 if k % 2 else 1]:
            took[name].append(sides[name](k))
        for name, values in took.items():
            rates[name].append(np.median(values, axis=0))
    return Measured(rates={n: np.array(v) for n, v in rates.items()}, contacts=contacts, touching=touching)


def show(measured: Measured) -> None:
    """Print the tables."""
    rates = measured.rates
    middle = {name: float(np.median(values, axis=0)[0]) for name, values in rates.items()}

    def paired(over: str, under: str) -> float:
        return float(np.median(rates[over] / rates[under], axis=0)[0])

    def ratio(over: str, under: str) -> str:
        wall, process = (rates[over] / rates[under]).T
        lowest, highest = wall.min(), wall.max()
        return f"{np.median(wall):5.2f} ({lowest:.2f} to {highest:.2f}; by process time {np.median(process):.2f})"

    print(f"emulated collection, recording on   {middle['ours']:8,.0f} steps/s   ours / theirs (goal {GOAL:g})")
    for task, rate_hz in product(TASKS, RATES_HZ):
        name = f"{task} {rate_hz}"
        print(f"  robosuite {task:17} {rate_hz:3} Hz {middle[name]:8,.0f} steps/s   {ratio('ours', name)}")
    old, new = VERSIONS["MuJoCo"], mujoco.__version__
    print(f"\nbare mj_step         in {old}     in {new} steps/s   newer / older; contacts in each")
    for name in SCENES:
        contacts = "{:.1f}, {:.1f}".format(*measured.contacts[name])
        rate = f"{middle[f'old {name}']:8,.0f}  {middle[f'new {name}']:8,.0f}"
        print(f"  {name:17} {rate}           {ratio(f'new {name}', f'old {name}')}; {contacts}")
    newer = paired("new ours", "old ours")
    for task in TASKS:
        theirs = f"{task} {RATES_HZ[0]}"
        whole, of_python = paired("ours", theirs), paired(f"old {task}", theirs)
        # Medians of the rounds each, so they multiply out only nearly.
        print(
            f"\n{task} at {RATES_HZ[0]} Hz, what {whole:.2f} is made of:\n"
            f"  {of_python:5.2f}  bare steps of its scene against its own: its Python "
            f"(mj_step is {1.0 / of_python:.0%} of its time)\n"
            f"  {paired('old ours', f'old {task}'):5.2f}  our scene against its scene, bare steps in {old}\n"
            f"  {newer:5.2f}  {new} against {old} on our scene; without it {whole / newer:.2f}\n"
            f"  {paired('ours', 'new ours'):5.2f}  our collection against bare steps of our scene; "
            f"at 1.00 the whole would be {paired('new ours', theirs):.1f}\n"
            f"  (its gripper touches something in {measured.touching[task]:.0%} of the steps)"
        )


def main() -> None:
    """Measure all sides in turn and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(tempfile.gettempdir(), "wrenchflow-robosuite")
    parser.add_argument("--env", type=Path, default=default, help="folder of robosuite's environment, made if absent")
    parser.add_argument("--task", default="peg-insertion", help="of our side")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    arguments = parser.parse_args()
    config = CollectConfig(operator="emulated", task=arguments.task)
    where = stay_on_one_core()
    peer = Peer(arguments.env.absolute())
    with tempfile.TemporaryDirectory() as name, black_boxes(Path(name, "boxes")):
        measured = measure(peer, Path(name), arguments.rounds, config)
    peer.close()
    print(f"one thread {where}; robosuite {VERSIONS['robosuite']} without recording and resets")
    print(
        f"medians of {arguments.rounds} rounds (lowest to highest), by wall time; ours is {EPISODES} episodes of "
        f"{config.task} a round\n"
    )
    show(measured)


if __name__ == "__main__":
    main()
