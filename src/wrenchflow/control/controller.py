"""The impedance controller as a person configures it: from gains and a rig to the records that the kernels run on."""

import numpy as np
from jaxtyping import Float

from wrenchflow.control import impedance as law
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.records import CTL, OBS, REQ
from wrenchflow.errors import ControlError
from wrenchflow.rig import Rig
from wrenchflow.spatial import log_so3, make_pose, rotation_of

TICK_S = 0.001
TICK_NS = 1_000_000
FAULTS = {0: "none", 1: "the robot's state was not finite", 2: "the torque was not finite"}


class Controller:
    """One arm's controller: an observation, a request and the state, each one record.

    The torque of a tick is `J^T (K e - D V) + N tau_null + c(q, dq)`, limited; see `control.impedance`.
    """

    def __init__(self, rig: Rig, config: ControlConfig) -> None:
        """Take the limits of `rig`; `start` must be called before the first `tick`."""
        self.obs = np.zeros(1, OBS)
        self.req = np.zeros(1, REQ)
        self.ctl = np.zeros(1, CTL)
        state = self.ctl[0]
        state["null_stiffness"] = config.nullspace_nm_rad
        state["ramp_ticks"] = round(config.ramp_s / TICK_S)
        state["design_ticks"] = max(1, round(1.0 / (config.damping_design_hz * TICK_S)))
        state["tau_max"] = np.array(rig.robot.torque_nm) * config.torque_share
        state["tau_step_max"] = np.array(rig.robot.torque_rate_nm_s) * config.torque_rate_share * TICK_S
        state["force_max"], state["moment_max"] = config.force_max_n, config.moment_max_nm
        state["x_step_max"] = config.speed_max_m_s * TICK_S
        state["turn_step_max"] = config.turn_max_rad_s * TICK_S
        state["workspace_min"], state["workspace_max"] = rig.workspace.min_m, rig.workspace.max_m
        state["K_lin_max"], state["K_rot_max"] = config.stiffness_max_n_m, config.stiffness_max_nm_rad
        state["damping_ratio_max"] = config.damping_ratio_max

    def start(self, impedance: Impedance) -> None:
        """Begin at the observed pose, which becomes the target."""
        law.start(self.obs[0], self.ctl[0])
        self.ask(self.target_pose, self.target_pose, ticks=1, impedance=impedance)

    @property
    def target_pose(self) -> Float[np.ndarray, " 7"]:
        """The target asked for at the last tick, before leash and limits."""
        return make_pose(self.ctl[0]["x_target"].copy(), self.ctl[0]["R_target"].copy())

    def ask(
        self,
        start: Float[np.ndarray, " 7"],
        stop: Float[np.ndarray, " 7"],
        *,
        ticks: int,
        impedance: Impedance,
        disturbance_m: Float[np.ndarray, " 3"] | None = None,
    ) -> None:
        """Ask for a straight segment of the target, and to stay at its end.

        Args:
            start: Target at the beginning of the segment.
            stop: Target at its end.
            ticks: How long it lasts.
            impedance: How stiffly it is followed.
            disturbance_m: Added to what is tracked, not to the target that is recorded [m]. Shape (3,).
        """
        if ticks < 1:
            raise ControlError(f"a segment lasts at least 1 tick, got {ticks}.")
        req = self.req[0]
        R_start = rotation_of(start[3:])
        req["x_start"], req["x_stop"], req["R_start"] = start[:3], stop[:3], R_start
        req["turn"] = log_so3(rotation_of(stop[3:]) @ R_start.T)
        req["ticks"] = ticks
        req["K_lin"] = np.eye(3) * impedance.translation_n_m
        req["K_rot"] = np.eye(3) * impedance.rotation_nm_rad
        req["damping_ratio"] = impedance.damping_ratio
        req["x_offset"] = 0.0 if disturbance_m is None else disturbance_m
        self.ctl[0]["segment_tick"] = 0

    def tick(self) -> Float[np.ndarray, " 7"]:
        """Decide one tick's torque [N.m], without gravity, from `obs` and `req`. Shape (7,), a view of the state."""
        law.tick_each(self.obs, self.req, self.ctl)
        return self.ctl["tau"][0]

    @property
    def fault(self) -> str:
        """What latched the controller, in words; `none` while it runs."""
        return FAULTS[int(self.ctl[0]["fault"])]
