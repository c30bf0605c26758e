"""A simulated arm in its scene: a `Robot` for the protocol, and a batch loop for speed. Both run the same kernels."""

from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.control.config import Impedance
from wrenchflow.control.controller import TICK_S, Controller
from wrenchflow.errors import ControlError
from wrenchflow.rig import Rig
from wrenchflow.sim import engine
from wrenchflow.sim.engine import MEASURE, NOISE_WIDTH, SEEN, WATCH_TICKS
from wrenchflow.sim.ft_sensor import SensorFaults, make_sensor
from wrenchflow.sim.row import ROW, record
from wrenchflow.spatial import exp_so3, inverse, make_pose, rotation_of

_NOISE_BLOCK_TICKS = 512
_UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
# Runs ticks, with the arguments of `engine.advance`.
Drive = Callable[..., None]
CHUNK_TICKS = 1000  # A compiled chunk does not hear Ctrl-C, so none is longer than a second.


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """How well the simulated arm knows itself: a real Panda's figures."""

    joint_position_noise_rad: float = 5e-5
    joint_velocity_noise_rad_s: float = 1e-3
    torque_noise_nm: float = 0.03
    orientation_error_rad: float = 1e-3
    sensor: SensorFaults = field(default_factory=SensorFaults)


class Plant:
    """One simulation. `model` may be shared between plants: nothing here writes to it.

    As a `Robot`, it compensates gravity and friction by itself, as the real arm does.
    """

    adds_gravity = True
    adds_friction = True

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        rig: Rig,
        measurement: Measurement,
        rng: np.random.Generator,
        *,
        capacity_s: float,
    ) -> None:
        """Take a scene at its start.

        Args:
            model: A model with the arm of `sim.panda`.
            data: Its state, with the start pose set.
            rig: The rig that the model was made of.
            measurement: Noise of joints and sensor.
            rng: Every random number of this plant.
            capacity_s: How long an episode can last.
        """
        # Once through the bindings: an engine error in a compiled loop would end the process.
        mujoco.mj_step(model, data)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        self.model, self.data, self.measurement, self._rig, self._rng = model, data, measurement, rig, rng
        self.rows = np.zeros(round(capacity_s / TICK_S), ROW)
        self.count = 0
        self._seen = np.zeros(len(self.rows) // WATCH_TICKS + 1, SEEN)
        self._measure = np.zeros(1, MEASURE)
        engine.point_to(self._measure, model, data)
        state = self._measure[0]
        state["joint_position_noise"] = measurement.joint_position_noise_rad
        state["joint_velocity_noise"] = measurement.joint_velocity_noise_rad_s
        state["torque_noise"] = measurement.torque_noise_nm
        self.orientation_error_rad = rng.normal(size=3) * measurement.orientation_error_rad / np.sqrt(3.0)
        state["R_error"] = exp_so3(self.orientation_error_rad)
        state["sensor"] = make_sensor(rig.sensor, measurement.sensor, rng, TICK_S)[0]
        self._unstable = {of.name: data.warning[of] for of in _UNSTABLE}
        self._white, self._drawn = np.empty((0, NOISE_WIDTH)), 0

    def hold(
        self,
        T_base_tcp: Float[np.ndarray, " 7"],
        *,
        stiffness_n_m: float,
        damping_n_s_m: float,
        stiffness_nm_rad: float,
        damping_nm_s_rad: float,
        force_max_n: float = 60.0,
    ) -> None:
        """Take the arm by its flange, and pull until its TCP is at a pose; `advance` feels it, the protocol does not.

        Args:
            T_base_tcp: Where the TCP should be. Shape (7,).
            stiffness_n_m: Of the arm that pulls; 0 to let go.
            damping_n_s_m: Of the same.
            stiffness_nm_rad: Of the wrist that turns.
            damping_nm_s_rad: Of the same.
            force_max_n: Nobody pulls harder.
        """
        hold = self._measure[0]["hold"]
        hold["x"], hold["R"] = T_base_tcp[:3], rotation_of(T_base_tcp[3:])
        hold["x_tcp_flange"] = inverse(np.array(self._rig.T_flange_tcp))[:3]
        hold["stiffness"], hold["damping"], hold["force_max"] = stiffness_n_m, damping_n_s_m, force_max_n
        hold["stiffness_rot"], hold["damping_rot"] = stiffness_nm_rad, damping_nm_s_rad
        if not stiffness_n_m:
            self.data.xfrc_applied[self.model.body("flange").id] = 0.0

    def begin(self, controller: Controller, impedance: Impedance) -> None:
        """Let a controller start at the measured pose, before the first tick."""
        self.read(controller.obs)
        self._measure["tick"] = 0
        controller.start(impedance)

    def advance(self, controller: Controller, ticks: int, drive: Drive | None = None) -> np.ndarray:
        """Run `ticks` ticks of the controller on the arm, recorded.

        Args:
            controller: Whose request stays as it is meanwhile.
            ticks: How many.
            drive: Runs them in place of `engine.advance`, and may change the controller's request meanwhile.

        Returns:
            The new rows, dtype `ROW`, as a view.

        Raises:
            ControlError: If MuJoCo had to reset an unstable state, or there is no room for the rows.
        """
        self._require_room(ticks)
        first = self.count
        for start in range(0, ticks, CHUNK_TICKS):
            count = min(CHUNK_TICKS, ticks - start)
            (drive or engine.advance)(
                self._measure,
                *self._noise(count),
                controller.obs,
                controller.req,
                controller.schedule,
                controller.ctl,
                self.rows,
                self._seen,
                self.count,
                count,
            )
            self.count += count
        self._check()
        return self.rows[first : self.count]

    def read(self, obs: np.ndarray) -> None:
        """Fill `obs` with this tick's state (the protocol's way, one tick at a time)."""
        engine.read(self._measure, *self._noise(1), obs)

    def write(self, tau: Float[np.ndarray, " 7"]) -> None:
        """Command a torque [N.m] and let one millisecond pass."""
        engine.write(self._measure, tau)

    def record(self, controller: Controller) -> None:
        """Store the row of a tick that went through `read` and `controller.tick`; `advance` does so by itself."""
        self._require_room(1)
        record(controller.obs, controller.ctl, self.rows, self.count)
        self.count += 1

    @property
    def sensor(self) -> np.void:
        """The sensor's record, dtype `ft_sensor.SENSOR`: the truth that its reading hides."""
        return self._measure[0]["sensor"]

    @property
    def recorded(self) -> np.ndarray:
        """All rows so far, dtype `ROW`, as a view."""
        return self.rows[: self.count]

    @property
    def seen(self) -> np.ndarray:
        """What a referee may see of what `advance` did, dtype `SEEN`, as a view: one a `WATCH_TICKS` ticks."""
        return self._seen[: -(-self.count // WATCH_TICKS)]

    @property
    def true_tcp_pose(self) -> Float[np.ndarray, " 7"]:
        """Where the TCP really is, which no controller knows."""
        site = self.data.site("tcp")
        return make_pose(site.xpos.copy(), site.xmat.reshape(3, 3).copy())

    def _require_room(self, ticks: int) -> None:
        if self.count + ticks > len(self.rows):
            raise ControlError(
                f"an episode of {len(self.rows)} ticks is full; {ticks} more were asked for at {self.count}."
            )

    def _noise(self, ticks: int) -> tuple[Float[np.ndarray, "n k"], int]:
        """Standard normal numbers, and where in them the next ticks' begin."""
        first = self._drawn
        if first + ticks > len(self._white):
            # Drawn in blocks, for a draw costs as much as a tick; the stream of numbers is the same in any blocks.
            blocks = -(-(first + ticks - len(self._white)) // _NOISE_BLOCK_TICKS)
            fresh = self._rng.standard_normal((blocks * _NOISE_BLOCK_TICKS, NOISE_WIDTH))
            self._white, first = np.concatenate([self._white[first:], fresh]), 0
        self._drawn = first + ticks
        return self._white, first

    def _check(self) -> None:
        for name, warning in self._unstable.items():
            if warning.number:
                raise ControlError(f"the simulation became unstable ({name}) after {self.count} ms.")
