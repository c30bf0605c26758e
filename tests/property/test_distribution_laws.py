"""Laws of what an analysis adds up: parts make the whole, and quantiles are as near as they are said to be."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.distribution import Distribution, tally
from wrenchflow.datasets.analysis.figures import EpisodeFigures
from wrenchflow.datasets.analysis.trajectory import Labels
from wrenchflow.datasets.analysis.twins import find_twins
from wrenchflow.datasets.analysis.voxels import Workspace, places_of, voxels_of

numbers = st.one_of(st.floats(-1e6, 1e6), st.just(np.nan), st.just(np.inf), st.just(0.0))


@given(arrays(np.float64, (40, 3), elements=numbers), st.lists(st.integers(1, 39), max_size=4))
def test_parts_make_the_whole(data, cuts):
    found = Distribution(3)
    for part in np.split(data, sorted(set(cuts))):
        found.add(tally(part))
    for i, column in enumerate(data.T):
        finite = np.sort(column[np.isfinite(column)])
        assert found.count[i] == len(finite)
        assert found.missing[i] == len(column) - len(finite)
        if not len(finite):
            assert np.isnan(found.mean[i])
            continue
        assert (found.low[i], found.high[i]) == (finite[0], finite[-1])
        np.testing.assert_allclose(found.mean[i], finite.mean(), rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(found.std[i], finite.std(), rtol=1e-7, atol=1e-6)
        for share in (0.0, 0.1, 0.5, 0.99, 1.0):
            # Between two values any is as good: the cells give the lower one.
            true = finite[int(np.floor(share * (len(finite) - 1)))]
            assert abs(found.quantile(share)[i] - true) <= 0.0101 * abs(true) + 1.1e-5
        edges = np.linspace(-1e6, 1e6, 7)
        assert found.counted(i, edges).sum() == len(finite)


@given(arrays(np.float64, (30, 3), elements=st.floats(-2.0, 2.0)))
def test_cells_hold_every_position(position_m):
    workspace = Workspace()
    for half in np.split(position_m, 2):
        workspace.add(*voxels_of(half, 0.05))
    assert workspace.visits.sum() == len(position_m)
    expected = {tuple(row) for row in np.floor(position_m / 0.05).astype(int).tolist()}
    assert {tuple(row) for row in workspace.cells.tolist()} == expected
    assert places_of(voxels_of(position_m, 0.05)[0]).min() >= -41


@settings(max_examples=40)
@given(st.integers(0, 2**31), st.integers(2, 30))
def test_every_near_duplicate_is_found_and_no_other(seed, count):
    rng = np.random.default_rng(seed)
    shapes = rng.normal(0.0, 0.5, (count, 16 * 7))
    for i in range(1, count):
        if rng.random() < 0.4:
            shapes[i] = shapes[rng.integers(0, i)] + rng.normal(0.0, rng.choice([0.005, 0.018, 0.022]), 16 * 7)
    config = AnalysisConfig()
    found = {(pair.first, pair.second) for pair in find_twins([figures(shape) for shape in shapes], config)}
    rows = shapes.astype(np.float32).astype(np.float64)
    apart = np.sqrt(((rows[:, None] - rows[None]) ** 2).mean(axis=2))
    first, second = np.nonzero(np.triu(apart < config.twin_rad, 1))
    assert found == set(zip(first.tolist(), second.tolist(), strict=True))


def figures(shape: np.ndarray) -> EpisodeFigures:
    return EpisodeFigures(
        id="", place="", labels=Labels(), values={}, missing=(), shape=shape.astype(np.float32), shape_of="joints"
    )
