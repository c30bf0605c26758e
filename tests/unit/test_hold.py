"""A hand at the flange: it moves the arm as its spring says, and the wrist sensor does not feel it."""

import numpy as np
import pytest

from wrenchflow.control.config import Impedance
from wrenchflow.spatial import IDENTITY_POSE

SOFT = Impedance(translation_n_m=75.0, rotation_nm_rad=5.0)
PULL = {"stiffness_n_m": 300.0, "damping_n_s_m": 25.0, "stiffness_nm_rad": 18.0, "damping_nm_s_rad": 0.8}


@pytest.fixture
def led(peg_plant, perfect, quiet_rig):
    """A soft arm that is asked to stay, and a hand that pulls it aside by 20 mm, until all rests."""
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig, capacity_s=12.0)
    plant.begin(controller, SOFT)
    plant.advance(controller, 1200)
    start = controller.target_pose
    controller.ask(start, start, ticks=1, impedance=SOFT)
    plant.hold(start + np.array([0.0, 0.02, 0.0, 0, 0, 0, 0]), **PULL)
    plant.advance(controller, 4000)
    return plant, controller, start


def test_the_arm_rests_where_its_spring_and_the_hands_are_equally_strong(led):
    plant, _, start = led
    moved_m = plant.true_tcp_pose[:3] - start[:3]
    shared = PULL["stiffness_n_m"] / (PULL["stiffness_n_m"] + SOFT.translation_n_m)
    # What joint friction and the posture's stiffness hold back is little.
    np.testing.assert_allclose(moved_m, [0.0, 0.02 * shared, 0.0], atol=6e-4)


def test_the_wrist_sensor_feels_nothing_of_the_hand_while_it_is_as_strong_as_a_contact(led):
    plant, _, start = led
    pulled_n = PULL["stiffness_n_m"] * (0.02 - (plant.true_tcp_pose[:3] - start[:3])[1])
    assert pulled_n > 1.0
    felt = plant.seen["wrench"][-100:].mean(0)  # Tared, and without the weight of a tool that was turned a little.
    np.testing.assert_allclose(felt[:3], 0.0, atol=0.02)
    np.testing.assert_allclose(felt[3:], 0.0, atol=0.002)


def test_let_go_of_the_arm_comes_back(led):
    plant, controller, start = led
    plant.hold(IDENTITY_POSE, **{name: 0.0 for name in PULL})
    plant.advance(controller, 4000)
    np.testing.assert_allclose(plant.true_tcp_pose[:3], start[:3], atol=6e-4)


def test_nobody_pulls_harder_than_a_person(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    plant.hold(controller.target_pose + np.array([0.0, 5.0, 0.0, 0, 0, 0, 0]), **PULL)
    plant.advance(controller, 5)
    force = plant.data.xfrc_applied[plant.model.body("flange").id][:3]
    assert np.linalg.norm(force) == pytest.approx(60.0)
