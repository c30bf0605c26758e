"""Laws of importing: units, signs and orders change numbers back and forth; what is dropped is counted."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from wrenchflow.episode import Episode, Stream
from wrenchflow.imports.estimates import estimate_rate
from wrenchflow.imports.import_folder import import_folder
from wrenchflow.imports.rotations import EULER, quaternions
from wrenchflow.imports.stamps import order_of, to_ns
from wrenchflow.imports.units import UNITS
from wrenchflow.recording.reader import read_episode
from wrenchflow.signals import POSITION, VELOCITY
from wrenchflow.spatial import rotation_of


def imported(folder: Path, mapping: str, path: Path) -> list[Episode]:
    (folder / "said.toml").write_text(f'task = "press"\n{mapping}')
    ((*done,),) = import_folder(folder / "said.toml", folder / "out", [path], overwrite=True)
    return [read_episode(folder / "out" / f"{each.id}.mcap") for each in done]


def write_table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = zip(*(map(repr, column.tolist()) for column in columns.values()), strict=True)
    path.write_text("\n".join([",".join(columns), *map(",".join, rows)]))
    return path


def known_size(unit: str) -> float:
    """Sizes by another way: from definitions of the units, not from our table."""
    pound_n, inch_m = 4.4482216152605, 0.0254
    return {
        **{"N": 1, "mN": 1 / 1000, "kN": 1000, "kgf": 9.80665, "gf": 9.80665 / 1000, "lbf": pound_n},
        **{"N.m": 1, "mN.m": 1 / 1000, "N.mm": 1 / 1000, "N.cm": 1 / 100, "kgf.cm": 9.80665 / 100},
        **{"lbf.in": pound_n * inch_m, "lbf.ft": pound_n * 0.3048},
        **{"m": 1, "cm": 1 / 100, "mm": 1 / 1000, "um": 1e-6, "in": inch_m},
        **{"rad": 1, "mrad": 1 / 1000, "deg": np.deg2rad(1)},
        **{"m/s": 1, "cm/s": 1 / 100, "mm/s": 1 / 1000, "in/s": inch_m},
        **{"rad/s": 1, "deg/s": np.deg2rad(1), "rpm": 2 * np.pi / 60},
    }[unit]


def test_every_unit_is_as_large_as_it_is_defined():
    for units in UNITS.values():
        for unit, size in units.items():
            assert size == pytest.approx(known_size(unit), rel=1e-15)


@pytest.mark.parametrize("sign", ["robot-on-environment", "environment-on-robot", "unknown"])
def test_a_table_in_other_units_and_signs_is_the_same_wrench(tmp_path, sign):
    rng = np.random.default_rng(1)
    force, moment = rng.normal(size=(2, 30, 3))
    scale = -1.0 if sign == "environment-on-robot" else 1.0
    data = scale * np.hstack([force / known_size("lbf"), moment / known_size("N.mm")])
    path = write_table(tmp_path / "a.csv", {"t": np.arange(30) * 8, **dict(zip("abcdef", data.T, strict=True))})
    said = f"""clock = {{ stamps = "t", unit = "ms" }}
    [streams.wrench_raw]
    force = {{ columns = ["a", "b", "c"], unit = "lbf" }}
    moment = {{ columns = ["d", "e", "f"], unit = "N.mm" }}
    frame = "sensor"
    sign = "{sign}"
    """
    (episode,) = imported(tmp_path, said, path)
    np.testing.assert_allclose(episode["wrench_raw"].data, np.hstack([force, moment]), rtol=1e-14)
    np.testing.assert_array_equal(episode["wrench_raw"].t, np.arange(30) * 8_000_000)
    notes = [note for note in episode.meta["import"]["notes"] if "wrench_raw" in note]
    assert len(notes) == (sign == "unknown")


def _axis(axis: str, angle: float) -> np.ndarray:
    """A rotation about one axis, written out."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "X": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "Y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "Z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@given(st.sampled_from(EULER), st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.booleans())
def test_euler_angles_turn_about_the_axes_that_are_said(order, angles, is_intrinsic):
    first, second, third = (_axis(axis, angle) for axis, angle in zip(order, angles, strict=True))
    # About axes that turn along, a later turn stands on the right; about axes that stay, on the left.
    expected = first @ second @ third if is_intrinsic else third @ second @ first
    quat_wxyz = quaternions(np.array([angles]), order, "intrinsic" if is_intrinsic else "extrinsic")
    np.testing.assert_allclose(rotation_of(quat_wxyz)[0], expected, atol=1e-12)


@pytest.mark.parametrize("order", ["wxyz", "xyzw", "ZYX"])
def test_a_pose_of_any_order_is_the_same_pose(tmp_path, order):
    turns = Rotation.random(20, random_state=2)
    numbers = {
        "wxyz": turns.as_quat(scalar_first=True),
        "xyzw": turns.as_quat(),
        "ZYX": turns.as_euler("ZYX", degrees=True),
    }[order]
    names = list("pqrs")[: len(order)]
    place_m = np.random.default_rng(0).normal(size=(20, 3))
    columns = {**dict(zip("xyz", 1000 * place_m.T, strict=True)), **dict(zip(names, numbers.T, strict=True))}
    path = write_table(tmp_path / "a.csv", columns)
    said = f"""clock = {{ rate_hz = 100 }}
    [streams.tcp_pose]
    position = {{ columns = ["x", "y", "z"], unit = "mm" }}
    orientation = {{ columns = {names}, order = "{order}"{', axes = "intrinsic", unit = "deg"' * (order == "ZYX")} }}
    frame = "base"
    """
    (episode,) = imported(tmp_path, said, path)
    np.testing.assert_allclose(episode["tcp_pose"].data[:, :3], place_m, rtol=1e-12)
    np.testing.assert_allclose(rotation_of(episode["tcp_pose"].data[:, 3:]), turns.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("said", "why"),
    [("unit = 'rad'", "in which order"), ("unit = 'rad', order = 'ZYX'", "about which axes")],
)
def test_an_orientation_that_nobody_states_is_not_invented(tmp_path, said, why):
    path = write_table(tmp_path / "a.csv", {name: np.arange(5.0) for name in "xyzabc"})
    (episode,) = imported(
        tmp_path,
        f"""clock = {{ rate_hz = 100 }}
        [streams.tcp_pose]
        position = {{ columns = ["x", "y", "z"], unit = "m" }}
        orientation = {{ columns = ["a", "b", "c"], {said} }}
        frame = "base"
        """,
        path,
    )
    assert list(episode.streams) == ["tcp_position"]
    assert any(why in note and "a, b, c" in note for note in episode.meta["import"]["notes"])


@given(st.lists(st.integers(0, 10), max_size=20))
def test_rows_that_are_kept_increase_and_the_others_are_counted(stamps):
    t = np.array(stamps, np.int64)
    order, latest, kept = order_of(t), -1, []
    for stamp in stamps:
        if stamp > latest:
            kept.append(stamp)
            latest = stamp
    assert t[order.keep].tolist() == kept
    assert order.repeated + order.backward == len(stamps) - len(kept)
    assert bool(order.first) == (len(kept) < len(stamps))
    assert (order.backward > 0) == any(a < max(stamps[:i]) for i, a in enumerate(stamps) if i)


@given(st.integers(0, 2**61), st.sampled_from([("s", 9), ("ms", 6), ("us", 3), ("ns", 0)]))
def test_stamps_as_text_keep_every_nanosecond(t_ns, unit):
    name, digits = unit
    text = f"{t_ns // 10**digits}.{t_ns % 10**digits:0{digits}d}" if digits else str(t_ns)
    assert to_ns([text], name, "t").tolist() == [t_ns]


@pytest.mark.parametrize("is_transposed", [False, True])
@pytest.mark.parametrize("takes", [1, 3])
def test_a_struct_array_is_as_many_episodes_whichever_way_its_arrays_lie(tmp_path, is_transposed, takes):
    forces = [np.random.default_rng(k).normal(size=(40 + k, 3)) for k in range(takes)]
    array = np.empty((1, takes), [("F", "O"), ("t", "O")])
    for k, force in enumerate(forces):
        array[0, k] = (force.T if is_transposed else force, np.arange(len(force)) * 0.002 - 0.01)
    savemat(tmp_path / "a.mat", {"runs": array})
    said = """clock = { stamps = "t", unit = "s" }
    file.takes = "runs"
    [streams.wrench_raw]
    force = { variable = "F", unit = "N" }
    frame = "sensor"
    sign = "robot-on-environment"
    """
    episodes = imported(tmp_path, said, tmp_path / "a.mat")
    assert [episode.id for episode in episodes] == [f"a-{k + 1}" for k in range(takes)]
    for episode, force in zip(episodes, forces, strict=True):
        np.testing.assert_array_equal(episode["wrench_raw"].data, force)
        # A clock that begins below zero is moved, which is noted.
        np.testing.assert_array_equal(episode["wrench_raw"].t, np.arange(len(force)) * 2_000_000)
        assert any("begin at -0.01 s" in note for note in episode.meta["import"]["notes"])


@given(st.floats(2e-4, 0.05), st.sampled_from([0, 1, 2]))
def test_the_rate_is_what_makes_a_velocity_the_slope_of_its_position(step_s, still):
    t = np.arange(400) * step_s
    hz = np.array([0.5, 0.8, 1.3]) / t[-1]
    position_m, velocity_m_s = (
        0.1 * np.sin(2 * np.pi * hz * t[:, None]),
        0.2 * np.pi * hz * np.cos(2 * np.pi * hz * t[:, None]),
    )
    position_m[:, still], velocity_m_s[:, still] = 0.3, 0.0  # An axis that does not move tells nothing, and harms not.
    stamps = np.arange(400, dtype=np.int64)
    rate = estimate_rate(
        {
            "tcp_position": Stream(stamps, position_m, POSITION, "base"),
            "tcp_velocity": Stream(stamps, velocity_m_s, VELOCITY, "base"),
        }
    )
    assert rate is not None
    assert rate.rate_hz == pytest.approx(1.0 / step_s, rel=1e-3)
    assert rate.r_squared[still] is None


def test_a_velocity_that_is_none_of_that_position_tells_no_rate():
    rng, stamps = np.random.default_rng(0), np.arange(400, dtype=np.int64)
    rate = estimate_rate(
        {
            "tcp_position": Stream(stamps, rng.normal(size=(400, 3)), POSITION, "base"),
            "tcp_velocity": Stream(stamps, rng.normal(size=(400, 3)), VELOCITY, "base"),
        }
    )
    assert rate is not None
    assert rate.rate_hz is None


def test_numbers_that_cannot_be_right_are_imported_as_they_are_said_and_noted(tmp_path):
    data = {name: np.array([0.0, 2e5]) for name in "abcxyz"}
    said = """clock = { rate_hz = 10 }
    [streams.wrench_raw]
    force = { columns = ["a", "b", "c"], unit = "N" }
    frame = "sensor"
    sign = "robot-on-environment"
    [streams.tcp_position]
    position = { columns = ["x", "y", "z"], unit = "m" }
    frame = "base"
    """
    (episode,) = imported(tmp_path, said, write_table(tmp_path / "a.csv", data))
    assert episode["wrench_raw"].data.max() == 2e5
    notes = [note for note in episode.meta["import"]["notes"] if "cannot be right" in note]
    assert [note.split()[0] for note in notes] == ["'wrench_raw'", "'tcp_position'"]
