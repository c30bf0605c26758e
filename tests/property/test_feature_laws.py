"""Laws of the features: one row as all rows, no dependence on where the base stands, decoding undoes encoding."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.policy.features import WITH_FORCE, Features, decode_actions, encode_actions
from wrenchflow.spatial import compose, exp_so3, log_so3, make_pose, rot6d_of, rotate_screw, rotation_of

seeds = st.integers(0, 2**32 - 1)


def poses(rng: np.random.Generator, count: int) -> np.ndarray:
    return make_pose(rng.normal(size=(count, 3)), exp_so3(rng.uniform(-1.5, 1.5, size=(count, 3))))


def observations(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    made = {name: rng.normal(size=(count, 6)) for name in ("tcp_twist", "wrench", "wrench_mean")}
    return made | {name: poses(rng, count) for name in ("tcp_pose", "goal_pose")}


def as_float32(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: value.astype(np.float32) for name, value in values.items()}


@given(seeds, st.integers(1, 40))
def test_one_row_at_a_time_equals_all_rows_at_once_bit_for_bit(seed, count):
    seen = as_float32(observations(np.random.default_rng(seed), count))
    features = Features(WITH_FORCE)
    at_once = features.encode(seen)
    one_by_one = [features.encode({name: value[k : k + 1] for name, value in seen.items()}) for k in range(count)]
    np.testing.assert_array_equal(at_once, np.concatenate(one_by_one))


@given(seeds)
def test_features_do_not_depend_on_where_the_base_stands(seed):
    rng = np.random.default_rng(seed)
    seen = observations(rng, 5)
    T_a_b = poses(rng, 1)[0]
    R_a_b = rotation_of(T_a_b[3:])
    moved = {name: compose(T_a_b, seen[name]) for name in ("tcp_pose", "goal_pose")}
    moved |= {name: rotate_screw(R_a_b, seen[name]) for name in ("tcp_twist", "wrench", "wrench_mean")}
    features = Features(WITH_FORCE)
    np.testing.assert_allclose(
        features.encode(as_float32(moved)), features.encode(as_float32(seen)), rtol=1e-4, atol=1e-5
    )


@given(seeds)
def test_decoding_undoes_encoding(seed):
    rng = np.random.default_rng(seed)
    target, goal = poses(rng, 7), poses(rng, 7).astype(np.float32)
    actions = np.concatenate([target[:, :3], rot6d_of(rotation_of(target[:, 3:]))], axis=1).astype(np.float32)
    back = decode_actions(encode_actions(actions, goal), goal)
    np.testing.assert_allclose(back[:, :3], target[:, :3], atol=2e-6)
    turn = np.swapaxes(rotation_of(target[:, 3:]), -1, -2) @ rotation_of(back[:, 3:])
    np.testing.assert_allclose(log_so3(turn), 0.0, atol=2e-6)
