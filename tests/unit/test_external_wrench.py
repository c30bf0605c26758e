"""The estimated wrench against the simulator's own gravity, and against wrenches that were planted."""

import mujoco
import numpy as np
import pytest

from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.external_wrench import estimate_wrench, holding_torque
from wrenchflow.kinematics import jacobians
from wrenchflow.rig import load_rig
from wrenchflow.sim.panda import READY_RAD, make_arm

CONFIG = AnalysisConfig()
FLANGE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def postures(count: int, seed: int = 3) -> np.ndarray:
    return READY_RAD + np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 7))


def test_holding_torque_is_the_simulators():
    spec = make_arm(load_rig("panda_peg"))
    tool = next(body for body in spec.bodies if body.name == "flange")
    hand = tool.add_body(name="hand", pos=list(CONFIG.hand_com_m), gravcomp=1.0)
    hand.explicitinertial = True
    hand.mass, hand.ipos, hand.fullinertia = CONFIG.hand_mass_kg, [0, 0, 0], [1e-3, 1e-3, 1e-3, 0, 0, 0]
    model = spec.compile()
    model.opt.gravity[:] = (0.0, 0.0, -9.81)
    q = postures(40)
    for row, expected in zip(q, holding_torque(q, CONFIG), strict=True):
        data = mujoco.MjData(model)
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_gravcomp, expected, atol=1e-9)


def test_a_planted_wrench_is_found_within_its_uncertainty():
    rng = np.random.default_rng(5)
    q = postures(4000)
    planted = rng.normal(0.0, [10.0] * 3 + [1.0] * 3, (len(q), 6))
    planted[:200] = 0.0
    noise = rng.normal(0.0, CONFIG.torque_std_nm, (len(q), 7))
    noise[:200] -= noise[:200].mean(axis=0)
    torque = holding_torque(q, CONFIG) + np.einsum("nij,ni->nj", jacobians(q, FLANGE)[1], planted) + noise + 0.7
    found = estimate_wrench(q, torque, 200, CONFIG)
    apart = (found.wrench - planted) / found.std
    told = np.isfinite(found.misfit) & np.isfinite(found.wrench).all(axis=1)
    assert told.mean() > 0.9
    np.testing.assert_allclose((apart[told] ** 2).mean(axis=0), 1.0, atol=0.15)
    assert found.misfit == pytest.approx(1.0, abs=0.1)
    assert (found.touch[:200][told[:200]] > 16.27).mean() < 0.02


def test_torques_that_contradict_the_assumption_raise_the_uncertainty():
    rng = np.random.default_rng(6)
    q = postures(2000)
    torque = holding_torque(q, CONFIG) + rng.normal(0.0, 3.0 * np.array(CONFIG.torque_std_nm), (len(q), 7))
    found = estimate_wrench(q, torque, 1000, CONFIG)
    assert found.misfit == pytest.approx(9.0, rel=0.15)
    assert (found.touch > 16.27).mean() < 0.02


def test_a_stretched_arm_is_not_assessed():
    q = np.zeros((3, 7))
    found = estimate_wrench(q, holding_torque(q, CONFIG), 1, CONFIG)
    assert np.isnan(found.wrench).all()
    assert np.isnan(found.std).all()
