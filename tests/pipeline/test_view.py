"""What `view` shows is what was recorded; read back by Rerun's own reader."""

import os
import subprocess
import sys

import numpy as np
import pytest

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.recording.images import image_messages, images_of, jpeg
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import FORCE, POSE, Signal


@pytest.fixture(scope="module")
def path(wrenchflow, tmp_path_factory):
    """A processed demonstration, with pictures of two cameras."""
    at = tmp_path_factory.mktemp("view")
    wrenchflow("collect", at / "raw", "--episodes", 1, "--seed", 3, "--tare-s", 0.5, "--jobs", 1)
    assert wrenchflow("process", at / "raw", at / "clean", "--jobs", 1).code == 0
    episode = read_episode(next((at / "clean").glob("*.mcap")))
    rng, t = np.random.default_rng(0), episode["tcp_pose"].t[::33]
    messages = {
        name: image_messages(t, [jpeg(rng.integers(0, 256, (24, 32, 3), np.uint8)) for _ in t], name)
        for name in ("camera/wrist", "camera/scene")
    }
    whole = Episode(
        episode.id, episode.task, episode.streams, episode.events, episode.meta, {**episode.messages, **messages}
    )
    write_episode(at / "whole.mcap", whole)
    return at / "whole.mcap"


@pytest.fixture(scope="module")
def episode(path):
    return read_episode(path)


@pytest.fixture(scope="module")
def shown(wrenchflow, path, rerun_columns):
    out = path.with_name("whole.rrd")
    assert wrenchflow("view", path, "--save", out, "--json").result == {"out": str(out)}
    assert not out.with_name("whole.rrd.partial").exists()
    return rerun_columns(out, "time")


def test_every_column_of_every_stream_is_there(shown, episode):
    for name, stream in episode.streams.items():
        parts = [key for key in shown if key[0].startswith(f"/{name}/") and key[1] == "Scalars:scalars"]
        columns = []
        for key in parts:
            t, rows = shown[key]
            np.testing.assert_array_equal(t, stream.t, err_msg=str(key))
            columns += list(np.array(rows).T)
        # Each column is drawn once; which plot it is in does not matter here.
        assert sorted(column.tobytes() for column in columns) == sorted(
            np.ascontiguousarray(column).tobytes() for column in stream.data.T
        ), name


def test_a_wrench_is_drawn_by_its_parts_with_names_and_colours_of_their_own(shown, episode):
    for part, columns in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        np.testing.assert_array_equal(
            shown[f"/wrench/{part}", "Scalars:scalars"][1], episode["wrench"].data[:, columns]
        )
        (names,) = shown[f"/wrench/{part}", "SeriesLines:names"][1]
        assert names == list(episode["wrench"].signal.columns[columns])
        assert len(set(shown[f"/wrench/{part}", "SeriesLines:colors"][1][0])) == 3


def test_poses_and_the_force_stand_in_space(shown, episode):
    for name in ("tcp_pose", "target_pose", "command_pose", "goal_pose"):
        t, translation = shown[f"/world/{name}", "Transform3D:translation"]
        quat_xyzw = np.array(shown[f"/world/{name}", "Transform3D:quaternion"][1])[:, 0]
        np.testing.assert_array_equal(t, episode[name].t)
        np.testing.assert_array_equal(np.array(translation)[:, 0], episode[name].data[:, :3].astype(np.float32))
        np.testing.assert_array_equal(quat_xyzw, episode[name].data[:, [4, 5, 6, 3]].astype(np.float32))
    ((path,),) = shown["/world/path", "LineStrips3D:strips"][1]
    np.testing.assert_array_equal(path[0], episode["tcp_pose"].data[0, :3].astype(np.float32))
    t, vectors = shown["/world/force", "Arrows3D:vectors"]
    np.testing.assert_array_equal(t, episode["wrench"].t)
    np.testing.assert_allclose(np.array(vectors)[:, 0], 0.01 * episode["wrench"].data[:, :3], rtol=1e-6)
    assert shown["/world/force", "Transform3D:translation"][1] == shown["/world/tcp_pose", "Transform3D:translation"][1]


def test_events_are_states_with_an_end(shown, episode):
    t, states = shown["/events/contact", "StateChange:state"]
    expected = {event.start_ns: "contact" for event in episode.events_of("contact")}
    ends = {event.stop_ns: None for event in episode.events_of("contact")}
    assert dict(zip(t.tolist(), (state[0] for state in states), strict=True)) == ends | expected
    t, states = shown["/events/phase", "StateChange:state"]
    for at_ns, state in zip(t.tolist(), (state[0] for state in states), strict=True):
        now = [event.label for event in episode.events_of("phase") if event.start_ns <= at_ns < event.stop_ns]
        assert state == (" + ".join(now) or None)
    assert shown["/events/success", "StateChange:state"][1] == [["success"]]


def test_energy_work_and_mode_of_the_safety_layer_are_plots_of_their_own(shown, episode):
    governor = episode["governor"]
    for quantity, columns in (
        ("energy", ["tank", "spring", "budget", "kinetic"]),
        ("work", ["damped", "fed", "posed", "saturated", "exerted", "filled"]),
        ("mode", ["mode"]),
    ):
        assert shown[f"/governor/{quantity}", "SeriesLines:names"][1] == [columns]
        rows = shown[f"/governor/{quantity}", "Scalars:scalars"][1]
        np.testing.assert_array_equal(rows, np.stack([governor.column(name) for name in columns], axis=1))


def test_what_the_safety_layer_did_is_a_lane_whose_colours_tell_hold_from_latched(rerun_columns, tmp_path, wrenchflow):
    t = 1_700_000_000_000_000_000 + np.arange(50, dtype=np.int64) * 10_000_000
    labels = ("hold: silence", "latched: impact", "hold: plan-end")
    events = tuple(Event(int(t[10 * k]), int(t[10 * k + 10]), "safety", label) for k, label in enumerate(labels))
    write_episode(tmp_path / "e.mcap", Episode("e", "", {"force": Stream(t, np.zeros((50, 3)), FORCE)}, events))
    assert wrenchflow("view", tmp_path / "e.mcap", "--save", tmp_path / "e.rrd").code == 0
    shown = rerun_columns(tmp_path / "e.rrd", "time")
    assert [state[0] for state in shown["/events/safety", "StateChange:state"][1]] == [*labels, None]
    (colours,) = shown["/events/safety", "StateConfiguration:colors"][1]
    assert colours[0] == colours[2] != colours[1]


def test_images_are_the_recorded_bytes(shown, episode):
    for name in ("camera/wrist", "camera/scene"):
        t, blobs = shown[f"/{name}", "EncodedImage:blob"]
        np.testing.assert_array_equal(t, episode.messages[name].t)
        assert [bytes(blob[0]) for blob in blobs] == [bytes(image.data) for image in images_of(episode.messages[name])]


def test_a_file_of_another_kind_is_shown_as_far_as_it_goes(tmp_path, wrenchflow, rerun_columns):
    t = 1_700_000_000_000_000_000 + np.arange(50, dtype=np.int64) * 10_000_000
    rng = np.random.default_rng(1)
    odd = Signal("force", ("fx", "fy", "fz"), ("N",) * 3)
    streams = {
        "gripper/force": Stream(t, rng.normal(size=(50, 3)), FORCE, "finger"),
        "cup": Stream(t[:0], np.empty((0, 7)), POSE, "table"),
        "wrench": Stream(t, rng.normal(size=(50, 3)), odd, "tool"),
    }
    overlapping = [Event(int(t[k]), int(t[k + 20]), "anomaly", f"a{k}") for k in (0, 10)]
    write_episode(tmp_path / "e.mcap", Episode("e", "", streams, tuple(overlapping)))
    assert wrenchflow("view", tmp_path / "e.mcap", "--save", tmp_path / "e.rrd").code == 0
    shown = rerun_columns(tmp_path / "e.rrd", "time")
    np.testing.assert_array_equal(shown["/gripper/force/force", "Scalars:scalars"][1], streams["gripper/force"].data)
    assert "/world/force" not in {entity for entity, _ in shown}
    states = [state[0] for state in shown["/events/anomaly", "StateChange:state"][1]]
    assert states == ["a0", "a0 + a10", "a10", None]


def test_what_is_wrong_is_said_in_a_line(tmp_path, wrenchflow, path, shown, monkeypatch):
    there = path.with_name("whole.rrd")
    before = there.read_bytes()
    said = {
        (there,): f"{there} exists already. --overwrite replaces it.",
        (tmp_path / "x.mcap",): f"Rerun opens files that end in .rrd, got '{tmp_path / 'x.mcap'}'.",
        (tmp_path / "no" / "x.rrd",): f"cannot write {tmp_path / 'no' / 'x.rrd.partial'}: no such file or directory.",
    }
    for (out,), text in said.items():
        ran = wrenchflow("view", path, "--save", out)
        assert (ran.code, ran.stdout, ran.stderr) == (1, "", f"wrenchflow: {text}\n")
    assert there.read_bytes() == before
    assert wrenchflow("view", path, "--save", there, "--overwrite").code == 0
    ran = wrenchflow("view", there, "--save", tmp_path / "y.rrd")
    assert ran.code == 1
    assert ran.stderr.startswith(f"wrenchflow: {there} is not an MCAP file")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_no_window_is_opened(wrenchflow, path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    ran = wrenchflow("view", path)
    expected = "there is no display to open a window on. --save OUT.rrd writes what it would show."
    assert (ran.code, ran.stderr) == (1, f"wrenchflow: {expected}\n")


def test_without_rerun_it_says_what_to_install(path):
    program = (
        "import sys; sys.modules['rerun'] = None; from wrenchflow.cli import main\n"
        f"sys.exit(main(['view', {str(path)!r}, '--save', 'x.rrd']))"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr == "wrenchflow: this needs rerun, which is not installed: install wrenchflow[view].\n"


def test_the_viewer_listens_on_the_loopback_and_speaks_to_nobody(monkeypatch):
    from wrenchflow.view.viewer import viewer_command, viewer_environment

    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.setenv("no_proxy", "github.com")
    program, *flags = viewer_command("--port", "auto")
    assert os.access(program, os.X_OK)
    assert flags[flags.index("--bind") + 1] == "127.0.0.1"
    environment = viewer_environment()
    assert environment["CI"]
    assert {"FORCE_RERUN_ANALYTICS", "no_proxy"}.isdisjoint(environment)
    assert all(environment[name].startswith("http://127.0.0.1:") for name in ("HTTPS_PROXY", "https_proxy"))
