"""Cameras beside the control loop: every picture with its own stamp, and no driver disturbs the rest."""

import io
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import Image

from wrenchflow.camera import Camera, Picture, View
from wrenchflow.clock import Clock
from wrenchflow.collect import sim_camera
from wrenchflow.collect.config import CameraConfig, CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.errors import CameraError, ConfigError
from wrenchflow.recording.container import Container
from wrenchflow.recording.images import image_messages, images_of, jpeg
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.validate import validate
from wrenchflow.signals import FORCE
from wrenchflow.sim.gl import find_gl
from wrenchflow.source import Column, Source

ROW = np.dtype([("t_ns", "i8"), ("force", "f8", (3,))], align=True)
LOOP = Source(name="loop", dtype=ROW, columns=(Column(name="force", signal=FORCE, frame="sensor"),))
VIEW = View(name="eye", width=64, height=48, rate_hz=50.0, driver="test", capture_latency_s=0.01)
needs_gl = pytest.mark.skipif(find_gl() is None, reason="neither EGL nor OSMesa works on this machine")


def scene(number: int) -> np.ndarray:
    """A picture that says which it is by how bright it is."""
    return np.full((48, 64, 3), 10 * number % 250, np.uint8)


@dataclass
class Flip:
    """Shows one picture after the other, of which it loses number 3; may fail in one way or another."""

    failure: str = ""

    @property
    def views(self) -> tuple[View, ...]:
        return (VIEW,)

    def open(self, clock: Clock) -> None:
        if self.failure == "absent":
            raise CameraError("camera 'eye' is not plugged in.")
        self._clock, self._number = clock, 0

    def take(self) -> list[Picture]:
        time.sleep(0.02)
        self._number += 1 + (self._number == 2)
        if self.failure == "breaks" and self._number > 5:
            raise RuntimeError("the cable was pulled")
        if self.failure == "crashes" and self._number > 5:
            os._exit(3)
        if self.failure == "gives up" and self._number > 5:
            sys.exit(3)
        if self.failure == "shrinks" and self._number > 5:
            return [Picture("eye", self._clock.now_ns(), self._number, scene(0)[:10])]
        t_ns = self._clock.now_ns() - round(VIEW.capture_latency_s * 1e9)
        return [Picture("eye", t_ns, self._number, scene(self._number))]

    def close(self) -> None:
        pass


def run_loop(path: Path, camera: Camera, duration_s: float = 1.0) -> bool:
    """A control loop beside a camera; whether all its rows were stored."""
    row, stored = np.zeros(1, ROW), []
    with Recorder(path, id="7", task="t", sources=[LOOP], cameras=[camera]) as recorder:
        stop_s = time.monotonic() + duration_s
        while time.monotonic() < stop_s:
            row["t_ns"] = recorder.clock.now_ns()
            stored.append(recorder.push("loop", row))
            time.sleep(0.001)
        assert recorder.is_alive
        recorder.finish({"success": True})
    return all(stored)


def in_a_script(tmp_path: Path, failure: str) -> tuple[subprocess.CompletedProcess, Path]:
    """Run the loop as a script: a camera of this file can be found by another process there only."""
    path = tmp_path / "e.mcap"
    ran = subprocess.run([sys.executable, __file__, str(path), failure], capture_output=True, text=True, check=False)
    return ran, path


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[subprocess.CompletedProcess, Path]:
    """A run in which nothing goes wrong."""
    return in_a_script(tmp_path_factory.mktemp("run"), "")


def test_every_picture_is_recorded_with_its_stamps_and_its_number(run):
    ran, path = run
    assert ran.returncode == 0, ran.stderr
    episode = read_episode(path)
    messages = episode.messages["camera/eye"]
    images = list(images_of(messages))
    assert len(images) > 10
    numbers = messages.sequence.tolist()
    assert numbers == [number for number in range(1, len(images) + 2) if number != 3]
    for number, image in zip(numbers, images, strict=True):
        assert (image.format, image.frame) == ("jpeg", "camera/eye")
        pixels = np.asarray(Image.open(io.BytesIO(image.data)))
        assert np.abs(pixels.astype(int) - scene(number)).max() <= 2
    assert [image.t_ns for image in images] == messages.t.tolist()
    late_ns = messages.received - messages.t
    assert (late_ns >= 10_000_000).all()  # Exposed 10 ms before the driver had it.
    recorded = episode.meta["recorded"]["eye"]
    assert (recorded["rows"], recorded["missing"], recorded["dropped"]) == (len(images), 1, 0)
    assert episode.meta["cameras"]["eye"]["capture_latency_s"] == 0.01
    assert validate(path).problems == ()


def test_pictures_lie_in_chunks_of_their_own_which_are_not_compressed_again(run):
    _, path = run
    container = Container(path)
    (eye,) = (id for id, channel in container.channels.items() if channel.topic == "/camera/eye")
    with_pictures = [chunk for chunk in container.chunks if eye in container.index(chunk)]
    assert with_pictures
    for chunk in container.chunks:
        has_pictures = chunk in with_pictures
        assert set(container.index(chunk)) == {eye} or not has_pictures
        assert chunk.compression == ("" if has_pictures else "zstd")


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        ("breaks", "camera 'eye' failed with RuntimeError: the cable was pulled"),
        pytest.param("crashes", "the process of camera 'eye' died", marks=pytest.mark.slow),
        pytest.param("gives up", "the process of camera 'eye' ended by itself", marks=pytest.mark.slow),
        pytest.param("shrinks", "camera 'eye' gave (10, 64, 3), expected (48, 64, 3)", marks=pytest.mark.slow),
    ],
)
def test_a_camera_that_fails_is_told_and_disturbs_nothing(tmp_path, failure, said):
    ran, path = in_a_script(tmp_path, failure)
    assert ran.returncode == 0, ran.stderr
    episode = read_episode(path)
    assert said in episode.meta["recorded"]["eye"]["problem"]
    assert len(episode.messages["camera/eye"]) == 4
    assert len(episode["force"]) > 300
    assert episode.meta["result"] == {"success": True}


def test_a_camera_that_is_not_there_is_told_before_anything_moves(tmp_path):
    ran, _ = in_a_script(tmp_path, "absent")
    assert ran.returncode == 1
    assert ran.stderr.strip().endswith("CameraError: camera 'eye' is not plugged in.")
    assert list(tmp_path.iterdir()) == []


def test_clocks_are_compared_while_it_is_recorded(tmp_path):
    path = tmp_path / "e.mcap"
    row_type = np.dtype([("t_ns", "i8"), ("clock_offset_ns", "i8"), ("force", "f8", (3,))], align=True)
    sensor = Source(name="sensor", dtype=row_type, columns=LOOP.columns)
    row = np.zeros(1, row_type)
    with Recorder(path, id="7", task="t", sources=[sensor]) as recorder:
        stop_s = time.monotonic() + 1.5
        while time.monotonic() < stop_s:
            row["t_ns"], row["clock_offset_ns"] = recorder.clock.now_ns(), 5_000_000_000
            recorder.push("sensor", row)
            time.sleep(0.01)
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        shown = [message for *_, message in reader.iter_decoded_messages(topics=["/clock_sync"])]
    by_source: dict[str, list[int]] = {}
    for message in shown:
        stamp, other = (time.sec * 10**9 + time.nanosec for time in (message.header.stamp, message.time_ref))
        by_source.setdefault(message.source, []).append(stamp - other)
    assert set(by_source) == {"system", "sensor"}
    assert len(by_source["system"]) >= 2
    assert all(abs(ahead_ns) < 50_000_000 for ahead_ns in by_source["system"])
    assert set(by_source["sensor"]) == {5_000_000_000}


@needs_gl
def test_pictures_in_virtual_time_show_each_moment_of_it(unchecked):
    config = CollectConfig(
        seed=3, tare_s=0.5, cameras=("wrist", "scene"), camera=CameraConfig(width=96, height=64, rate_hz=30.0)
    )
    with unchecked():
        episode, bare = demonstrate(0, config), demonstrate(0, replace(config, cameras=()))
    assert episode.streams == bare.streams  # What happens does not depend on who looks.
    wrist = episode.messages["camera/wrist"]
    between_ns = np.diff(wrist.t)
    assert set(between_ns.tolist()) == {33_000_000, 34_000_000}
    assert abs(between_ns.mean() - 1e9 / 30) < 1e5
    pixels = [np.asarray(Image.open(io.BytesIO(image.data)), int) for image in images_of(wrist)]
    assert all(picture.shape == (64, 96, 3) for picture in pixels)
    assert max(picture.std() for picture in pixels) > 20  # There is something to be seen,
    assert np.abs(pixels[-1] - pixels[0]).mean() > 3  # and it changes when the arm moves,
    assert np.abs(pixels[3] - pixels[0]).mean() < 1  # not while it rests.
    view = episode.meta["cameras"]["wrist"]
    assert view["driver"].startswith("mujoco-")
    assert len(view["T_parent_camera"]) == 7


@needs_gl
def test_a_picture_shows_a_point_where_the_cameras_pose_says_that_it_is(peg, rig, peg_model):
    """Pinhole arithmetic with the recorded extrinsics and field of view finds the yellow mouth of the hole."""
    import mujoco

    from wrenchflow.sim.render import Renderer
    from wrenchflow.sim.state import looks_of
    from wrenchflow.sim.tasks.task import mjcf_of
    from wrenchflow.spatial import compose, inverse, make_pose

    data = mujoco.MjData(peg_model)
    scene = peg.draw(peg_model, np.random.default_rng(5))
    peg.place(peg_model, data, scene)
    renderer = Renderer(mjcf_of(peg, rig), str(find_gl()), 320, 240)
    renderer.set(looks_of(peg_model, data))
    for mount in rig.cameras:
        red, green, blue = (renderer.draw(mount.name)[..., i].astype(int) for i in range(3))
        rows, columns = np.nonzero((red > 1.5 * blue) & (green > 1.2 * blue) & (red > 120))
        seen = np.array([columns.mean(), rows.mean()])
        flange = data.body("flange")
        parents = {
            "base": make_pose(np.zeros(3), np.eye(3)),
            "flange": make_pose(flange.xpos.copy(), flange.xmat.reshape(3, 3).copy()),
        }
        T_base_camera = compose(parents[mount.parent], np.array(mount.T_parent_camera))
        x, y, z = compose(inverse(T_base_camera), scene.T_base_goal)[:3]
        focal = 120.0 / np.tan(mount.fov_y_rad / 2.0)
        expected = np.array([160.0 + focal * x / z, 120.0 + focal * y / z])
        assert np.abs(seen - expected).max() < 0.03 * 320, mount.name
    renderer.close()


@needs_gl
@pytest.mark.slow
def test_cameras_in_real_time_by_the_command(tmp_path, wrenchflow):
    ran = wrenchflow(
        *("collect", tmp_path / "raw", "--episodes", 1, "--seed", 3, "--tare-s", 0.5, "--realtime"),
        *("--cameras", "wrist", "scene", "--camera.width", 64, "--camera.height", 64, "--json"),
    )
    assert ran.result["successes"] == 1
    (path,) = (tmp_path / "raw").glob("*.mcap")
    episode = read_episode(path)
    for name in ("wrist", "scene"):
        messages = episode.messages[f"camera/{name}"]
        first_ns, last_ns = episode["tcp_pose"].t[[0, -1]]
        # Picture k is of 1/30 s times k + 1 after the start; one that came too late for a slow machine is missing.
        at_ns = np.ceil((messages.sequence + 1) * 1000 / 30) * 1_000_000
        np.testing.assert_array_equal(messages.t - first_ns, at_ns)
        assert messages.t[-1] <= last_ns + 1_000_000
        recorded = episode.meta["recorded"][name]
        assert len(messages) + recorded["missing"] >= messages.sequence[-1]
    assert wrenchflow("replay", path, "--json").result["tcp_divergence_m"] == 0.0
    assert wrenchflow("process", tmp_path / "raw", tmp_path / "clean", "--jobs", 1).code == 0
    clean = read_episode(tmp_path / "clean" / path.name)
    assert clean.messages == episode.messages
    assert clean.attachments == episode.attachments
    assert {"model.xml", "model.mjb.gz", "config.json", "calibration.json"} <= set(clean.attachments)
    config = json.loads(clean.attachments["config.json"].data)
    assert config["collect"]["cameras"] == ["wrist", "scene"]


def test_where_nothing_can_be_drawn_collection_goes_on_without_and_says_so_once(
    monkeypatch, caplog, tmp_path, unchecked
):
    from wrenchflow.collect.folder import collect_folder

    monkeypatch.setattr(sim_camera, "find_gl", lambda: None)
    config = CollectConfig(episodes=2, tare_s=0.5, cameras=("wrist",))
    with unchecked():
        done = list(collect_folder(tmp_path / "raw", config))
        with pytest.raises(CameraError, match="neither EGL nor OSMesa"):
            demonstrate(0, config)
    assert len(done) == 2
    assert [record.message.split(":")[0] for record in caplog.records] == ["no cameras are recorded"]
    assert not read_episode(tmp_path / "raw" / f"{done[0].id}.mcap").messages


def test_the_quick_way_to_tell_what_a_scene_looks_like_tells_the_same(peg, peg_model):
    import mujoco

    from wrenchflow.sim.state import Looks, looks_of

    data = mujoco.MjData(peg_model)
    looks = Looks(data)  # Found once, before the scene is set.
    peg.place(peg_model, data, peg.draw(peg_model, np.random.default_rng(5)))
    told = np.zeros(len(looks_of(peg_model, data)))
    looks.into(told)
    np.testing.assert_array_equal(told, looks_of(peg_model, data))


@pytest.mark.parametrize("way", ["osmesa", "egl", "nonsense"])
def test_a_way_to_draw_that_does_not_work_stops_nobody_who_draws_nothing(tmp_path, way):
    """MuJoCo itself ends at its import where MUJOCO_GL names a library that is not there."""
    code = "from wrenchflow.sim.tasks import scenery; print(scenery('peg-insertion', 'panda_peg')[2].nq)"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env={**os.environ, "MUJOCO_GL": way}
    )
    assert (ran.returncode, ran.stdout) == (0, "7\n"), ran.stderr


def test_a_camera_that_the_rig_does_not_have_is_named(rig):
    with pytest.raises(ConfigError, match=r"unknown camera 'wirst'. Did you mean 'wrist'\? Available: scene, wrist"):
        rig.camera("wirst")


def test_images_survive_and_what_is_none_is_refused():
    t = np.array([5, 7], np.int64)
    pictures = [jpeg(scene(1)), b""]
    messages = image_messages(t, pictures, "camera/ä")
    assert [(bytes(i.data), i.t_ns, i.frame, i.format) for i in images_of(messages)] == [
        (pictures[0], 5, "camera/ä", "jpeg"),
        (pictures[1], 7, "camera/ä", "jpeg"),
    ]


if __name__ == "__main__":
    sys.exit(0 if run_loop(Path(sys.argv[1]), Flip(sys.argv[2])) else 1)
