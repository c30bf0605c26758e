"""Normalisation: the usual range on [-1, 1], floors under columns that hardly move, labels unchanged."""

import numpy as np
import pytest
import torch

from wrenchflow.errors import DatasetError
from wrenchflow.policy.learned import Scaling
from wrenchflow.policy.normaliser import OBSERVATION_BOUND, fit_actions, fit_observations


def test_one_hard_knock_does_not_squeeze_the_usual_forces():
    force = np.random.default_rng(0).uniform(-5.0, 5.0, size=(2000, 1))
    force[7] = 500.0
    scaling = Scaling(fit_observations(force, ("force_n",), (0.5,)))
    scaled = scaling(torch.from_numpy(force).float())
    assert scaled[:7].abs().max() > 0.5
    assert float(scaled[7]) == OBSERVATION_BOUND


def test_a_column_that_hardly_moves_is_not_blown_up():
    still = np.full((100, 1), 0.2)
    still[::2] += 1e-6
    scaling = Scaling(fit_observations(still, ("position_m",), (1e-3,)))
    assert scaling(torch.tensor([[0.2005]])).abs().item() == pytest.approx(1.0, abs=0.01)
    assert scaling(torch.from_numpy(still).float()).abs().max() < 0.01


def test_labels_fill_the_range_and_come_back():
    actions = np.random.default_rng(1).normal(size=(500, 3)).astype(np.float32)
    scaling = Scaling(fit_actions(actions, ("a", "b", "c"), (1e-3,) * 3))
    values = torch.from_numpy(actions)
    assert scaling(values).min().item() == pytest.approx(-1.0)
    assert scaling(values).max().item() == pytest.approx(1.0)
    torch.testing.assert_close(scaling.undo(scaling(values)), values)
    beyond = torch.full((1, 3), 40.0)
    torch.testing.assert_close(scaling.undo(scaling(beyond)), beyond)


def test_a_value_that_is_not_finite_is_named_by_its_column():
    values = np.zeros((10, 2))
    values[3, 1] = np.nan
    with pytest.raises(DatasetError, match=r"not finite in: force_n\.$"):
        fit_observations(values, ("position_m", "force_n"), (1e-3, 0.5))
    with pytest.raises(DatasetError, match="no steps"):
        fit_actions(np.zeros((0, 1)), ("a",), (1.0,))
