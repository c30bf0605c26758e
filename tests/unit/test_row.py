"""A row says what was asked, what was given and why: its columns are the controller's, by their names."""

import numpy as np
import pytest

from wrenchflow.control.records import CTL, OBS
from wrenchflow.signals import GOVERNOR, IMPEDANCE, REQUEST
from wrenchflow.sim.row import ROW, record


@pytest.fixture
def ticked():
    """A controller's state in which every number differs from every other, and the row of its tick."""
    obs, ctl, rows = np.zeros(1, OBS), np.zeros(1, CTL), np.zeros(1, ROW)
    obs["R"][0] = ctl["R_target"][0] = ctl["R_d"][0] = np.eye(3)
    given = ("K_lin", "K_rot", "damping_ratio", "wrench_command")
    asked = ("K_lin_target", "K_rot_target", "damping_ratio_target", "wrench_target", "gripper_target")
    energies = ("tank", "spring", "budget", "kinetic", "damped", "fed", "posed", "saturated", "exerted", "filled")
    fresh = iter(np.random.default_rng(0).normal(size=1000))
    for name in (*given, *asked, *energies, "wrench", "impact"):
        ctl[name] = np.array([next(fresh) for _ in range(ctl[name].size)]).reshape(ctl[name].shape)
    ctl["mode"], ctl["cause"], ctl["acting"] = 2, -1, 2**34 + 2**9 + 1
    record(obs, ctl, rows, 0)
    return ctl[0], {name: rows[0][name] for name in ROW.names}


def column(row, signal, name):
    return row[signal.kind][signal.columns.index(name)]


def test_the_governors_scalars_are_the_state_of_their_names(ticked):
    ctl, row = ticked
    names = GOVERNOR.columns[: GOVERNOR.columns.index("fx")]
    assert len(names) == 13
    for name in names:
        assert column(row, GOVERNOR, name) == ctl[name], name


def test_which_safeguards_acted_is_exact_in_a_double(ticked):
    _, row = ticked
    assert int(column(row, GOVERNOR, "acting")) == 2**34 + 2**9 + 1


def test_forces_are_what_was_given_and_the_norms_of_what_was_felt(ticked):
    ctl, row = ticked
    first = GOVERNOR.columns.index("fx")
    np.testing.assert_array_equal(row["governor"][first : first + 6], ctl["wrench_command"])
    for name, vector in (("force", ctl["wrench"][:3]), ("moment", ctl["wrench"][3:]), ("impact", ctl["impact"])):
        assert column(row, GOVERNOR, name) == pytest.approx(np.linalg.norm(vector), rel=1e-15), name


def test_what_was_asked_stands_in_the_columns_of_what_was_given(ticked):
    ctl, row = ticked
    for signal, suffix in ((IMPEDANCE, ""), (REQUEST, "_target")):
        values = dict(zip(signal.columns, row[signal.kind], strict=True))
        for part in ("lin", "rot"):
            for i, a in enumerate("xyz"):
                for j, b in enumerate("xyz"):
                    assert values[f"k_{part}_{a}{b}"] == ctl[f"K_{part}{suffix}"][i, j]
        assert values["damping_ratio"] == ctl[f"damping_ratio{suffix}"]
    assert [column(row, REQUEST, name) for name in ("fx", "fy", "fz", "tx", "ty", "tz")] == list(ctl["wrench_target"])
    assert column(row, REQUEST, "gripper") == ctl["gripper_target"]


def test_a_gripper_that_nothing_was_asked_of_is_nan():
    obs, ctl, rows = np.zeros(1, OBS), np.zeros(1, CTL), np.zeros(1, ROW)
    ctl["gripper_target"] = np.nan
    record(obs, ctl, rows, 0)
    assert np.isnan(column(rows[0], REQUEST, "gripper"))
