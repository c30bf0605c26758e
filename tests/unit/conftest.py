"""A recording whose truth is known: a payload, a bias, and a push, worked out apart from the code under test."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.rig import load_rig
from wrenchflow.signals import FORCE, JOINTS, POSE, WRENCH

PERIOD_NS = 1_000_000
TRUE_BIAS = np.array([1.2, -0.8, 1.9, 0.05, -0.03, 0.02])


def _raw_wrench(rig, R_base_tcp: Rotation, force_base_n: np.ndarray, moment_base_nm: np.ndarray) -> np.ndarray:
    """Reading without bias of a sensor whose tcp exerts a wrench (about the tcp, base axes), by plain statics."""
    R_flange_tcp = Rotation.from_quat(rig.T_flange_tcp[3:], scalar_first=True)
    R_flange_sensor = Rotation.from_quat(rig.sensor.T_flange_sensor[3:], scalar_first=True)
    R_base_flange = R_base_tcp * R_flange_tcp.inv()
    R_base_sensor = R_base_flange * R_flange_sensor
    # Arms in base axes from the sensor's origin to the tcp and to the centre of mass.
    to_tcp = R_base_flange.apply(np.subtract(rig.T_flange_tcp[:3], rig.sensor.T_flange_sensor[:3]))
    to_com = R_base_sensor.apply(rig.payload.com_sensor_m)
    weight_n = rig.payload.mass_kg * np.array([0.0, 0.0, 9.81])
    force = force_base_n + weight_n
    moment = moment_base_nm + np.cross(to_tcp, force_base_n) + np.cross(to_com, weight_n)
    return np.hstack([R_base_sensor.inv().apply(force), R_base_sensor.inv().apply(moment)])


@pytest.fixture
def raw_wrench() -> Callable[..., np.ndarray]:
    return _raw_wrench


@pytest.fixture
def recording() -> Callable[..., Episode]:
    """Two seconds at rest at a tilted pose: a tare for 0.5 s, and a push of (0, 3, -10) N from 1.0 to 1.5 s."""

    def make(
        *,
        id: str = "0007",
        seed: int = 0,
        push_n: tuple[float, float, float] = (0.0, 3.0, -10.0),
        noise: float = 1.0,
        force_only: bool = False,
        samples: int = 2000,
        rig=None,
    ) -> Episode:
        rig = rig or load_rig("panda_peg")
        rng = np.random.default_rng(seed)
        t = 5_000_000_000 + np.arange(samples, dtype=np.int64) * PERIOD_NS
        R_base_tcp = Rotation.from_euler("xyz", [np.pi, 0.0, 0.0]) * Rotation.from_rotvec([0.2, -0.3, 0.5])
        pose = np.tile(np.concatenate([[0.5, 0.0, 0.3], R_base_tcp.as_quat(scalar_first=True)]), (samples, 1))
        force = np.zeros((samples, 3))
        force[1000:1500] = push_n
        raw = _raw_wrench(rig, R_base_tcp, force, np.zeros((samples, 3))) + TRUE_BIAS
        raw += noise * rig.sensor.noise * rng.normal(size=raw.shape)
        wrench = Stream(t, raw[:, :3].copy(), FORCE, "sensor") if force_only else Stream(t, raw, WRENCH, "sensor")
        streams = {
            "wrench_raw": wrench,
            "tcp_pose": Stream(t, pose, POSE, "base"),
            "joint_states": Stream(t, np.zeros((samples, JOINTS.width)), JOINTS),
        }
        tare = Event(int(t[0]), int(t[0]) + 500 * PERIOD_NS, "phase", "tare")
        return Episode(id, "push", streams, (tare,), {"rig": to_mapping(rig), "result": {"success": True}})

    return make


@pytest.fixture
def true_bias() -> np.ndarray:
    return TRUE_BIAS
