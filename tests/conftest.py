"""Shape checks on every function with a jaxtyping signature, and reproducible property tests."""

import importlib.util
import pkgutil
import signal
from dataclasses import replace
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from jaxtyping import install_import_hook

import wrenchflow


def _is_kernel(name: str) -> bool:
    # Compiled kernels are left alone: the hook would wrap functions that numba has to see bare.
    spec = importlib.util.find_spec(name)
    return spec is None or spec.origin is None or "wrenchflow.compiled import" in Path(spec.origin).read_text()


_hook = install_import_hook(
    [
        module.name
        for module in pkgutil.walk_packages(wrenchflow.__path__, "wrenchflow.")
        if not module.ispkg and not _is_kernel(module.name)
    ],
    "beartype.beartype",
)

hypothesis.settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("reproducible")


@pytest.fixture(scope="session", autouse=True)
def _somebody_at_the_keyboard():
    # A shell that runs tests in the background has them ignore Ctrl-C, and every command that they start with them.
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def rig():
    """The rig that comes with wrenchflow."""
    from wrenchflow.rig import load_rig

    return load_rig("panda_peg")


@pytest.fixture(scope="session")
def quiet_rig(rig):
    """The same with a sensor without noise."""
    return replace(rig, sensor=replace(rig.sensor, noise_force_n=0.0, noise_torque_nm=0.0))


@pytest.fixture(scope="session")
def peg():
    """The peg-insertion task."""
    from wrenchflow.sim.tasks import make_task

    return make_task("peg-insertion")


@pytest.fixture(scope="session")
def peg_model(peg, rig):
    """The MuJoCo model of peg insertion, which no test may write to."""
    from wrenchflow.sim.tasks.task import make_model

    return make_model(peg, rig)


@pytest.fixture(scope="session")
def perfect():
    """A measurement without noise or error."""
    from wrenchflow.sim.ft_sensor import SensorFaults
    from wrenchflow.sim.plant import Measurement

    sensor = SensorFaults(
        bias_force_n=0.0, bias_torque_nm=0.0, drift_n_min=0.0, drift_nm_min=0.0, quantum_n=0.0, quantum_nm=0.0
    )
    return Measurement(
        joint_position_noise_rad=0.0,
        joint_velocity_noise_rad_s=0.0,
        torque_noise_nm=0.0,
        orientation_error_rad=0.0,
        sensor=sensor,
    )


@pytest.fixture(scope="session")
def peg_plant(peg, peg_model, rig):
    """Make a plant and its controller, begun, at the start of a scene of peg insertion, or at joint angles."""
    import mujoco

    from wrenchflow.control.config import ControlConfig, Impedance
    from wrenchflow.control.controller import Controller
    from wrenchflow.sim.plant import Measurement, Plant

    def make(
        seed=0, *, measurement=None, with_rig=None, model=None, q_rad=None, capacity_s=8.0, control=None, impedance=None
    ):
        model, with_rig = model or peg_model, with_rig or rig
        rng = np.random.default_rng(seed)
        scene, data = peg.draw(model, rng), mujoco.MjData(model)
        peg.place(model, data, scene)
        if q_rad is not None:
            data.qpos[:] = q_rad
            mujoco.mj_forward(model, data)
        plant = Plant(model, data, with_rig, measurement or Measurement(), rng, capacity_s=capacity_s)
        controller = Controller(with_rig, control or ControlConfig())
        controller.set_contact_zone(*peg.contact_zone(scene))
        plant.begin(controller, impedance or Impedance())
        return plant, controller, scene

    return make


@pytest.fixture(scope="session")
def follow():
    """Make what follows plans and nothing else: a schedule and the targets that it writes. Times are in ms.

    It begins in RUN, at rest at (0, 0, 0.1) with a tool that points down, in a workspace from -0.5 to 0.5 m.
    """
    from wrenchflow.control import schedule as plans
    from wrenchflow.control.config import Impedance
    from wrenchflow.control.packet import REASONS
    from wrenchflow.control.plan import Plan, packet_of
    from wrenchflow.control.records import CTL

    class Follower:
        start_ns = 1_577_836_801_000_000_000

        def __init__(self, **constants):
            self.schedule = plans.make_schedule((-0.5,) * 3, (0.5,) * 3, **constants)
            self.ctl = np.zeros(1, CTL)
            state = self.ctl[0]
            state["x_target"], state["R_target"] = [0.0, 0.0, 0.1], np.diag([1.0, -1.0, -1.0])
            state["K_lin_target"], state["K_rot_target"] = 500.0 * np.eye(3), 20.0 * np.eye(3)
            state["damping_ratio_target"], state["gripper_target"] = 0.8, np.nan

        def ns(self, t_ms):
            return self.start_ns + np.rint(np.multiply(t_ms, 1e6)).astype(np.int64)

        def packet(self, t_ms, poses, t_obs_ms, *, period_ms=50, **given):
            """A packet of waypoints at `t_ms`, made from an observation at `t_obs_ms`."""
            fields = {name: given.pop(name) for name in ("wrench", "gripper") if name in given}
            t_obs_ns, period_ns = int(self.ns(t_obs_ms)), round(period_ms * 1e6)
            plan = Plan.of_poses(self.ns(t_ms), poses, Impedance(), t_obs_ns=t_obs_ns, period_ns=period_ns, **fields)
            packet = packet_of(plan)
            for name, values in given.items():
                packet[name][0, : len(t_ms)] = values
            return packet

        def accept(self, packet, now_ms):
            """What becomes of a packet at a time, by name."""
            now_ns = int(self.ns(now_ms))
            return tuple(REASONS)[int(plans.accept(packet[0], self.schedule[0], self.ctl[0], now_ns))]

        def at(self, t_ms):
            """The record of targets at a time, as a copy."""
            plans.evaluate(self.schedule[0], int(self.ns(t_ms)), self.ctl[0])
            return self.ctl[0].copy()

        def counts(self):
            """Packets by what became of them, those that were."""
            return {name: int(n) for name, n in zip(REASONS, self.schedule[0]["counts"], strict=True) if n}

        def clone(self, **constants):
            """One that stands where this one stands, with other constants."""
            other = Follower(**constants)
            kept = {name: other.schedule[0][name].copy() for name in ("lead_ns", "blend_ns", "oldest_ns")}
            other.schedule[:], other.ctl[:] = self.schedule, self.ctl
            for name, value in kept.items():
                other.schedule[0][name] = value
            return other

    return Follower


@pytest.fixture(scope="session")
def rerun_columns():
    """All that Rerun's own reader finds in an .mcap or an .rrd: values, and stamps [ns], by entity and component.

    Static values have no stamps.
    """
    import rerun as rr

    def read(path: Path, timeline: str) -> dict[tuple[str, str], tuple[np.ndarray, list]]:
        reader = rr.chunk.McapReader(path) if path.suffix == ".mcap" else rr.chunk.RrdReader(path)
        parts: dict[tuple[str, str], list[tuple[np.ndarray, list]]] = {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            names = set(batch.schema.names) - {"rerun.controls.RowId", *chunk.timeline_names}
            stamps = batch.column(timeline).cast("int64").to_numpy() if timeline in chunk.timeline_names else None
            for name in names:
                rows = batch.column(name).to_pylist()
                parts.setdefault((chunk.entity_path, name), []).append((stamps, rows))
        found = {}
        for key, pieces in parts.items():
            rows = [row for _, some in pieces for row in some]
            stamped = [stamps for stamps, _ in pieces if stamps is not None]
            stamps = np.concatenate(stamped) if stamped else np.empty(0, np.int64)
            order = np.argsort(stamps, kind="stable")
            found[key] = (stamps[order], [rows[i] for i in order] if stamped else rows)
        return found

    return read
