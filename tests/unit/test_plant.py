"""The plant: at rest it stays, its rows are the same however they are asked for, and each has the right stamp."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from wrenchflow.control.config import Impedance
from wrenchflow.errors import ControlError, StreamError
from wrenchflow.sim.engine import EPOCH_NS, TICK_NS
from wrenchflow.sim.row import ROW
from wrenchflow.sim.streams import streams_of
from wrenchflow.spatial import rotation_of


def down_on_the_block(plant, controller, scene, ticks: int = 700) -> None:
    """Ask for a press beside the hole, so that contact is in what is compared."""
    target = scene.T_base_goal.copy()
    target[:3] += [0.004, 0.0, -0.02]
    controller.ask(controller.target_pose, target, ticks=ticks, impedance=Impedance())


def by_protocol(plant, controller, ticks: int) -> np.ndarray:
    first = plant.count
    for _ in range(ticks):
        plant.read(controller.obs)
        torque = controller.tick()
        plant.record(controller)
        plant.write(torque)
    return plant.recorded[first:]


@pytest.mark.parametrize("seed", range(3))
def test_zero_command_keeps_an_arm_at_rest_where_it_is(peg_plant, seed):
    plant, controller, _scene = peg_plant(seed)
    start = plant.data.qpos.copy()
    for _ in range(1000):
        plant.read(controller.obs)
        plant.write(np.zeros(7))
    assert np.abs(plant.data.qpos - start).max() < 1e-6


def test_without_the_simulators_compensation_it_falls(peg_plant, peg_model):
    model = copy.copy(peg_model)
    model.body_gravcomp[:] = 0.0
    plant, controller, _ = peg_plant(model=model)
    start = plant.data.qpos.copy()
    for _ in range(100):
        plant.read(controller.obs)
        plant.write(np.zeros(7))
    assert np.abs(plant.data.qpos - start).max() > 0.01


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not(peg_plant):
    rows = []
    for seed in (3, 3, 4):
        plant, controller, scene = peg_plant(seed)
        down_on_the_block(plant, controller, scene)
        rows.append(plant.advance(controller, 1600).tobytes())
    assert rows[0] == rows[1]
    assert rows[0] != rows[2]


@pytest.mark.parametrize("chunks", [[1] * 1600, [10] * 160, [511, 1, 1088], [512, 1024, 64]])
def test_how_time_is_cut_changes_no_bit(peg_plant, chunks):
    whole = peg_plant(1)
    down_on_the_block(*whole)
    expected = whole[0].advance(whole[1], 1600)
    cut = peg_plant(1)
    down_on_the_block(*cut)
    rows = np.concatenate([cut[0].advance(cut[1], ticks) for ticks in chunks])
    assert whole[0].data.ncon > 0  # It does touch the block.
    assert rows.tobytes() == expected.tobytes()
    assert cut[0].recorded.tobytes() == expected.tobytes()


def test_chunks_longer_than_a_second_are_cut_without_a_trace(peg_plant):
    plant, controller, _ = peg_plant(1)
    expected = plant.advance(controller, 2500).tobytes()
    plant, controller, _ = peg_plant(1)
    assert b"".join(plant.advance(controller, 500).tobytes() for _ in range(5)) == expected


def test_the_protocol_gives_the_rows_of_the_batch_loop_bit_for_bit(peg_plant):
    whole = peg_plant(2)
    down_on_the_block(*whole, ticks=2200)  # From higher up: faster, it would hit, and the arm would let go.
    expected = whole[0].advance(whole[1], 2600)
    assert whole[0].data.ncon > 0  # It does touch the block.
    stepped = peg_plant(2)
    down_on_the_block(*stepped, ticks=2200)
    assert by_protocol(stepped[0], stepped[1], 2600).tobytes() == expected.tobytes()
    assert stepped[0].data.qpos.tobytes() == whole[0].data.qpos.tobytes()


def test_batch_and_protocol_may_take_turns(peg_plant):
    whole = peg_plant(2)
    expected = whole[0].advance(whole[1], 300)
    mixed = peg_plant(2)
    mixed[0].advance(mixed[1], 100)
    by_protocol(mixed[0], mixed[1], 100)
    mixed[0].advance(mixed[1], 100)
    assert mixed[0].recorded.tobytes() == expected.tobytes()


def test_two_plants_may_share_a_model(peg_plant):
    alone = peg_plant(1)
    expected = alone[0].advance(alone[1], 200).tobytes()
    one, other = peg_plant(1), peg_plant(9)
    parts = []
    for _ in range(4):
        parts.append(one[0].advance(one[1], 50).tobytes())
        other[0].advance(other[1], 50)
    assert b"".join(parts) == expected


def test_a_row_is_what_its_tick_saw_and_commanded(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    for k in range(50):
        plant.read(controller.obs)
        q, x = plant.data.qpos.copy(), plant.data.site("tcp").xpos.copy()
        tau = controller.tick().copy()
        plant.record(controller)
        row = plant.recorded[k]
        np.testing.assert_array_equal(row["joint_states"][:7], q)
        np.testing.assert_allclose(row["tcp_pose"][:3], x, atol=1e-15)
        np.testing.assert_allclose(rotation_of(row["tcp_pose"][3:]), controller.obs["R"][0], atol=1e-14)
        np.testing.assert_array_equal(row["joint_command"], tau)
        assert row["t_ns"] == EPOCH_NS + k * TICK_NS
        plant.write(tau)


def test_forces_are_stamped_with_the_tick_that_they_belong_to(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    plant.advance(controller, 20)
    push = plant.data.xfrc_applied[plant.model.body("tool").id]
    push[:3] = [0.0, 0.0, 50.0]  # From tick 20 on.
    plant.advance(controller, 5)
    streams = streams_of(plant.recorded)
    change = np.abs(np.diff(streams["wrench_raw"].data[:, 2]))
    felt_ns = streams["wrench_raw"].t[1:][change > 1.0][0]
    assert felt_ns == EPOCH_NS + 20 * TICK_NS
    moved = np.abs(streams["joint_states"].column("dq2")) > 1e-4
    # Speed is that of the beginning of a tick, so it answers one tick later.
    assert streams["joint_states"].t[moved][0] == EPOCH_NS + 21 * TICK_NS


def test_rows_become_streams_with_nothing_held_or_made_up():
    rows = np.zeros(5, ROW)
    rows["t_ns"] = EPOCH_NS + np.arange(5) * TICK_NS
    for name in ROW.names[1:]:
        rows[name] = np.arange(5)[:, None]
    streams = streams_of(rows)
    assert set(streams) == set(ROW.names[1:])
    for name, stream in streams.items():
        late = name in ("wrench_raw", "external_torque")
        np.testing.assert_array_equal(stream.t, rows["t_ns"][: 4 if late else 5])
        np.testing.assert_array_equal(stream.data[:, 0], np.arange(1 if late else 0, 5))
    assert streams["wrench_raw"].frame == "sensor"
    assert streams["tcp_pose"].frame == "base"
    rows[:] = 0  # Streams own their numbers.
    assert streams["tcp_pose"].data[-1, 0] == 4.0
    with pytest.raises(StreamError, match="at least 2 rows, got 1"):
        streams_of(rows[:1])


def test_recorded_quaternions_never_flip(peg_plant):
    plant, controller, _ = peg_plant(5)
    rows = plant.advance(controller, 1000)
    for name in ("tcp_pose", "target_pose", "command_pose"):
        quat = rows[name][:, 3:]
        assert ((quat[1:] * quat[:-1]).sum(1) > 0.99).all()
        assert quat[0][np.argmax(np.abs(quat[0]))] > 0.0


def test_measured_joints_and_pose_are_off_by_what_a_real_arm_is_off(peg_plant):
    plant, controller, _ = peg_plant(7, capacity_s=3.0)
    plant.advance(controller, 1000)
    noise, q = [], []
    for _ in range(1000):
        plant.read(controller.obs)
        plant.write(controller.tick())
        q.append(plant.data.qpos.copy())
        noise.append(controller.obs["q"][0].copy())
    spread = np.std(np.diff(np.array(noise), axis=0) - np.diff(np.array(q), axis=0)) / np.sqrt(2.0)
    assert spread == pytest.approx(5e-5, rel=0.1)
    error = controller.obs["R"][0] @ plant.data.site("tcp").xmat.reshape(3, 3).T
    angle = np.arccos(np.clip((np.trace(error) - 1.0) / 2.0, -1.0, 1.0))
    assert angle == pytest.approx(np.linalg.norm(plant.orientation_error_rad), abs=3e-4)


def test_noise_of_the_joints_shows_in_the_pose_as_their_kinematics_say(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(with_rig=quiet_rig, measurement=replace(perfect, joint_position_noise_rad=5e-5))
    shadow = mujoco.MjData(plant.model)
    for _ in range(50):
        plant.read(controller.obs)
        shadow.qpos[:] = controller.obs["q"][0]
        mujoco.mj_kinematics(plant.model, shadow)
        np.testing.assert_allclose(controller.obs["x"][0], shadow.site("tcp").xpos, atol=5e-8)
        np.testing.assert_allclose(controller.obs["R"][0], shadow.site("tcp").xmat.reshape(3, 3), atol=5e-8)
        plant.write(controller.tick())


def test_an_episode_that_is_full_says_so_and_writes_nothing(peg_plant):
    plant, controller, _ = peg_plant(capacity_s=0.05)
    plant.advance(controller, 45)
    with pytest.raises(ControlError, match=r"^an episode of 50 ticks is full; 6 more were asked for at 45\.$"):
        plant.advance(controller, 6)
    plant.advance(controller, 5)
    with pytest.raises(ControlError, match="is full; 1 more were asked for at 50"):
        plant.record(controller)
    assert plant.count == 50


def test_a_state_that_mujoco_had_to_reset_is_a_known_error(peg_plant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log where it runs.
    plant, controller, _ = peg_plant()
    plant.data.qvel[3] = np.nan
    with pytest.raises(ControlError, match="the simulation became unstable"):
        plant.advance(controller, 10)
