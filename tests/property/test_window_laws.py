"""Laws of training windows: inside one episode, in order, every step once the current one."""

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.train.windows import make_windows, window_rows

lengths = st.lists(st.integers(1, 12), min_size=1, max_size=6)


@given(lengths, st.integers(1, 4), st.integers(0, 8))
def test_every_window_lies_in_one_episode_and_repeats_only_its_edges(lengths, n_obs_steps, ahead):
    horizon = n_obs_steps + ahead
    rows = window_rows(lengths, n_obs_steps=n_obs_steps, horizon=horizon)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    first = np.cumsum([0, *lengths])[:-1]
    assert (episode[rows] == episode[rows[:, :1]]).all()
    moved = np.diff(rows, axis=1)
    at_first = rows[:, :-1] == first[episode[rows[:, :-1]]]
    at_last = rows[:, 1:] == (first + lengths - 1)[episode[rows[:, 1:]]]
    assert ((moved == 1) | ((moved == 0) & (at_first | at_last))).all()


@given(lengths, st.integers(1, 4), st.integers(0, 8))
def test_every_step_is_the_current_step_of_one_window(lengths, n_obs_steps, ahead):
    rows = window_rows(lengths, n_obs_steps=n_obs_steps, horizon=n_obs_steps + ahead)
    np.testing.assert_array_equal(rows[:, n_obs_steps - 1], np.arange(sum(lengths)))


@given(lengths, st.integers(0, 2**31))
def test_a_batch_holds_what_its_rows_say(lengths, seed):
    # The value of a step is its row, so a batch shows which rows it was gathered from.
    stops = np.cumsum(lengths)
    values = [
        np.arange(stop - count, stop, dtype=np.float32)[:, None] for stop, count in zip(stops, lengths, strict=True)
    ]
    windows = make_windows(values, values, n_obs_steps=2, horizon=5)
    observations, actions = windows.draw(16, torch.Generator().manual_seed(seed))
    assert observations.shape == (16, 2, 1)
    current = observations[:, 1, 0].long()
    expected = torch.from_numpy(window_rows(lengths, n_obs_steps=2, horizon=5))[current]
    assert torch.equal(actions[:, :, 0].long(), expected)
    assert torch.equal(observations[:, :, 0].long(), expected[:, :2])
