"""The arena: the 7-joint arm in MuJoCo at one of four places, driven a tick at a time with everything written down."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np

from safety.trace import Log, Trace
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.rig import Rig, load_rig
from wrenchflow.sim.ft_sensor import SensorFaults
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks import scenery
from wrenchflow.spatial import compose, exp_so3, make_pose

PERFECT = Measurement(
    joint_position_noise_rad=0.0,
    joint_velocity_noise_rad_s=0.0,
    torque_noise_nm=0.0,
    orientation_error_rad=0.0,
    sensor=SensorFaults(
        bias_force_n=0.0, bias_torque_nm=0.0, drift_n_min=0.0, drift_nm_min=0.0, quantum_n=0.0, quantum_nm=0.0
    ),
)
_AWAY_M = (5.0, 5.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where the tool is, in the goal's frame (z into the hole), and what it is asked to do there if nobody interferes.

    Attributes:
        name: In tables.
        start_m: Of the TCP at the start.
        press_m: Where the target goes along z; the spring presses with what is missing.
        swing_m: How far the target swings along x, 5 mm/s.
        block: Whether there is anything to touch but the floor.
    """

    name: str
    start_m: tuple[float, float, float]
    press_m: float = 0.0
    swing_m: float = 0.0
    block: bool = True

    def target_m(self, t_s: float) -> np.ndarray:
        """What is asked for, `t_s` after the start, in the goal's frame."""
        triangle = 0.0
        if self.swing_m:
            phase = (t_s * 0.005 / self.swing_m) % 4.0
            triangle = self.swing_m * (phase if phase < 1.0 else 2.0 - phase if phase < 3.0 else phase - 4.0)
        x, y, _ = self.start_m
        return np.array([x + triangle, y, self.press_m])


PLACES = {
    place.name: place
    for place in (
        Place(name="free", start_m=(0.0, 0.0, -0.20), press_m=-0.20, block=False),
        Place(name="wall", start_m=(0.036, 0.0, -0.0005), press_m=0.013),
        Place(name="hole", start_m=(0.0, 0.0, 0.015), press_m=0.02),
        Place(name="sliding", start_m=(0.036, 0.0, -0.0005), press_m=0.013, swing_m=0.008),
    )
}

Tamper = Callable[[np.ndarray], None]


class Arena:
    """One run: a plant, its controller, a place, and a log of every tick."""

    def __init__(
        self,
        place: str,
        seed: int,
        *,
        noisy: bool = True,
        control: ControlConfig | None = None,
        without: Iterable[str] = (),
        waits: int = 100,
    ) -> None:
        """Put the arm there.

        Args:
            place: Of `PLACES`.
            seed: Scene and noise.
            noisy: Whether joints and sensor have a real arm's noise.
            control: Limits and gains.
            without: Safeguards that are left out, by name.
            waits: For so many ticks nobody asks for anything: the sensor's bias is taken.
        """
        self.place, self.rig, self.noisy = PLACES[place], _rig(noisy), noisy
        task, _, model = scenery("peg-insertion", "panda_peg")
        rng = np.random.default_rng((seed, 17))
        self.rng = np.random.default_rng((seed, 19))  # For scripts that are given no other.
        scene, data = task.draw(model, rng), mujoco.MjData(model)
        self.T_base_goal = scene.T_base_goal
        start = self.pose_of(np.array(self.place.start_m))
        task.place(model, data, replace(scene, q_start_rad=joints_at(model, start)))
        if not self.place.block:
            data.mocap_pos[0] = _AWAY_M
            mujoco.mj_forward(model, data)
        measurement = Measurement() if noisy else PERFECT
        self.plant = Plant(model, data, self.rig, measurement, rng, capacity_s=0.001)
        self.config = control or ControlConfig(ramp_s=0.2)
        self.controller = Controller(self.rig, self.config, without=without)
        if self.place.block:
            self.controller.set_contact_zone(*task.contact_zone(scene))
        self.tampers: dict[str, Tamper] = {}
        # A hand holds the flange, above the sensor: what it does to the tool goes through it. Base axes.
        self.hand_n, self.hand_nm = np.zeros(3), np.zeros(3)
        self.log = Log()
        self._tool, self._flange = model.body("tool").id, model.body("flange").id
        self.plant.begin(self.controller, Impedance())
        self.run(waits)
        req = self.controller.req[0]
        req["K_lin"], req["K_rot"], req["damping_ratio"] = np.eye(3) * 600.0, np.eye(3) * 25.0, 0.9

    def pose_of(self, position_m: np.ndarray, turn_rad: np.ndarray | None = None) -> np.ndarray:
        """A TCP pose in the base frame, given in the goal's."""
        turn = np.zeros(3) if turn_rad is None else turn_rad
        return compose(self.T_base_goal, make_pose(np.asarray(position_m, float), exp_so3(np.asarray(turn, float))))

    @property
    def base_target(self) -> np.ndarray:
        """What the place asks for now."""
        return self.pose_of(self.place.target_m(self.log.count * 0.001))

    def play(self, *scripts: Iterator[int], ticks: int) -> Trace:
        """Let scripts act on this arena, each whenever it wants to, for `ticks` ticks; return what happened.

        Args:
            scripts: Each acts when it is resumed, and yields after how many ticks it wants to act again.
            ticks: How long.

        Returns:
            Everything since the arena was made.
        """
        stop, due = self.log.count + ticks, [self.log.count] * len(scripts)
        playing = list(scripts)
        self.log.make_room(ticks)
        while self.log.count < stop:
            for i, script in enumerate(playing):
                if due[i] <= self.log.count:
                    # A script counts with what the controller was told, and that may be no number.
                    with np.errstate(all="ignore"):
                        due[i] = self.log.count + max(1, next(script, stop))
            self.run(min([stop, *due]) - self.log.count)
        return self.log.trace

    def run(self, ticks: int) -> None:
        """Let time pass."""
        plant, controller, log = self.plant, self.controller, self.log
        log.make_room(ticks)
        data, truth = plant.data, log.truth
        obs_bytes, req_bytes, before, after = log.bytes
        obs, req, ctl = (each.view(np.uint8) for each in (controller.obs, controller.req, controller.ctl))
        site = data.site("tcp")
        for k in range(log.count, log.count + ticks):
            plant.read(controller.obs)
            truth["q"][k], truth["dq"][k] = data.qpos, data.qvel
            truth["x"][k], truth["R"][k] = site.xpos, site.xmat.reshape(3, 3)
            truth["J"][k], truth["M"][k] = controller.obs["J"][0], controller.obs["M"][0]
            if self.tampers:
                truth["tampered"][k] = True
                for tamper in list(self.tampers.values()):
                    tamper(controller.obs[0])
            obs_bytes[k], req_bytes[k], before[k] = obs, req, ctl
            tau = controller.tick()
            after[k] = ctl
            data.xfrc_applied[self._flange, :3], data.xfrc_applied[self._flange, 3:] = self.hand_n, self.hand_nm
            plant.write(tau)
            truth["q_after"][k], truth["dq_after"][k] = data.qpos, data.qvel
            truth["hand"][k], truth["hand_moment"][k] = self.hand_n, self.hand_nm
            # MuJoCo's external forces are those on the body, and hold what is applied besides contacts.
            truth["contact"][k] = -data.cfrc_ext[self._tool, 3:]
            truth["elsewhere"][k] = self.hand_n - data.cfrc_ext[1 : self._tool, 3:].sum(0)
            truth["constraint"][k], truth["contacts"][k] = data.qfrc_constraint, data.ncon
        log.count += ticks
        _require_stable(data)


_UNSTABLE = [int(getattr(mujoco.mjtWarning, f"mjWARN_{name}")) for name in ("BADQPOS", "BADQVEL", "BADQACC")]


def _require_stable(data: mujoco.MjData) -> None:
    if any(data.warning.number[_UNSTABLE]):
        raise FloatingPointError("the simulation became unstable.")


@cache
def _rig(noisy: bool) -> Rig:
    rig = load_rig("panda_peg")
    if noisy:
        return rig
    return replace(rig, sensor=replace(rig.sensor, noise_force_n=0.0, noise_torque_nm=0.0))
