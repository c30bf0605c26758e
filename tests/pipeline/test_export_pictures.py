"""Pictures from recordings to data sets, as the peers read them: the right one at each step, and in its place."""

from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np
import pytest

from wrenchflow.datasets import video
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.export import export_folder
from wrenchflow.datasets.pictures import decode
from wrenchflow.datasets.sample import STREAMS
from wrenchflow.episode import Episode, Stream
from wrenchflow.recording.images import image_messages, jpeg
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import JOINTS, POSE, TWIST, WRENCH

pytestmark = [
    # What lerobot and those it is built on deprecate among themselves is not ours to mend.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
]

START_NS = 1_700_000_000_000_000_000
SIGNALS = {"joint_states": JOINTS, "tcp_twist": TWIST, "wrench": WRENCH}
FEATURE = "observation.images.wrist"
LENGTHS_S = (1.0, 1.5, 0.8)


def scene(number: int, side_px: int) -> np.ndarray:
    """A picture that says which it is by how bright it is, and which way up it is by its upper half."""
    pixels = np.full((side_px, side_px, 3), 40 + 4 * number, np.uint8)
    pixels[: side_px // 2, :, 0] = 255
    return pixels


def brightness(pixels: np.ndarray) -> float:
    """Of the lower half, where it is grey."""
    return float(np.median(pixels[len(pixels) // 2 + 4 :, :, 1]))


def recording(index: int, length_s: float, cameras=("wrist", "scene"), side_px: int = 96) -> Episode:
    rng = np.random.default_rng(index)
    n = round(1000 * length_s)
    streams = {}
    for name in STREAMS:
        signal, samples = SIGNALS.get(name, POSE), 1 if name == "goal_pose" else n
        data = rng.normal(size=(samples, signal.width))
        if signal is POSE:
            data[:, 3:] /= np.linalg.norm(data[:, 3:], axis=1, keepdims=True)
        streams[name] = Stream(START_NS + np.arange(samples, dtype=np.int64) * 1_000_000, data, signal, "base")
    t = START_NS + np.arange(0, n, 33, dtype=np.int64) * 1_000_000
    messages = {
        f"camera/{name}": image_messages(t, [jpeg(scene(k, side_px)) for k in range(len(t))], f"camera/{name}")
        for name in cameras
    }
    return Episode(f"{index:04d}", "peg", streams, (), {"result": {"success": True}}, messages)


@pytest.fixture(scope="module", autouse=True)
def _offline(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        home = tmp_path_factory.mktemp("huggingface")
        patch.setenv("HF_HOME", str(home))
        patch.setenv("HF_LEROBOT_HOME", str(home / "lerobot"))
        patch.setenv("HF_DATASETS_CACHE", str(home / "datasets"))
        yield


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("clean")
    for index, length_s in enumerate(LENGTHS_S):
        write_episode(folder / f"{index:04d}.mcap", recording(index, length_s))
    return folder


@pytest.fixture(scope="module")
def out(clean, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video, "FILE_BYTES", -1)  # So that there is more than one file.
        list(export_folder("robomimic,lerobot", clean, folder, ExportConfig(image_px=32)))
    return folder


def expected(step: int) -> int:
    """Number of the last picture at or before a step, at 20 steps a second and a picture every 33 ms."""
    return step * 50 // 33


def test_lerobot_finds_the_picture_of_every_step(out):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("local/seen", root=out / "lerobot", video_backend="pyav")
    assert dataset.meta.camera_keys == ["observation.images.scene", "observation.images.wrist"]
    videos = list((out / "lerobot" / "videos" / FEATURE).rglob("*.mp4"))
    assert len(videos) > 1
    for index in range(len(dataset)):
        item = dataset[index]
        pixels = (item[FEATURE].numpy().transpose(1, 2, 0) * 255).round()
        assert pixels.shape == (96, 96, 3)
        assert brightness(pixels) == pytest.approx(40 + 4 * expected(int(item["frame_index"])), abs=1.9)
        assert pixels[4:40, :, 0].mean() > 240  # The right way up, and red is red.


def test_statistics_of_pictures_are_those_of_every_pixel(out):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    stats = LeRobotDataset("local/seen", root=out / "lerobot", video_backend="pyav").meta.stats[FEATURE]
    steps = [len(range(0, round(1000 * length_s), 50)) - 1 for length_s in LENGTHS_S]
    seen = np.stack([decode(jpeg(scene(expected(k), 96))) for n in steps for k in range(n)]) / 255
    assert stats["mean"].shape == (3, 1, 1)
    assert stats["count"].tolist() == [len(seen)]
    channels = seen.reshape(-1, 3)
    np.testing.assert_allclose(stats["mean"].ravel(), channels.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(stats["std"].ravel(), channels.std(axis=0), atol=1e-6)
    for name, fraction in (("q01", 0.01), ("q50", 0.5), ("q90", 0.9)):
        np.testing.assert_allclose(stats[name].ravel(), np.quantile(channels, fraction, axis=0), atol=1e-6)


def test_the_hdf5_holds_the_same_pictures_in_its_size(out):
    with h5py.File(out / "robomimic.hdf5") as file:
        for demo in file["data"].values():
            pixels = demo["obs/wrist_image"]
            assert pixels.shape == (demo.attrs["num_samples"], 32, 32, 3)
            assert pixels.dtype == np.uint8
            for k in range(len(pixels)):
                np.testing.assert_array_equal(pixels[k], decode(jpeg(scene(expected(k), 96)), (32, 32)))


def test_steps_may_lie_where_a_camera_took_its_pictures(clean, tmp_path):
    config = ExportConfig(grid="wrist", rate_hz=30.0, cameras=())
    list(export_folder("robomimic,lerobot", clean, tmp_path / "out", config))
    with h5py.File(tmp_path / "out" / "robomimic.hdf5") as file:
        assert set(np.diff(file["data/demo_0/t_ns"])) == {33_000_000}
        assert not any(name.endswith("_image") for name in file["data/demo_0/obs"])
        assert Fraction(file["data"].attrs["rate_hz"]) == 30


def test_recordings_of_other_cameras_are_left_out_and_encoders_are_silent(tmp_path, capfd):
    folder = tmp_path / "clean"
    folder.mkdir()
    write_episode(folder / "0000.mcap", recording(0, 0.5))
    write_episode(folder / "0001.mcap", recording(1, 0.5, cameras=("wrist",)))
    write_episode(folder / "0002.mcap", recording(2, 0.5, side_px=64))
    results = {one.id: one for one in export_folder("lerobot", folder, tmp_path / "out", ExportConfig())}
    assert not results["0000"].left_out
    assert "'camera/scene' is not in" in results["0001"].left_out
    assert "64 x 64, expected scene 96 x 96" in results["0002"].left_out
    assert "Svt" not in capfd.readouterr().err
