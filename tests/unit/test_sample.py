"""What a gap does to the steps of an episode, where cameras put them, and what an increment is."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchflow.datasets.about import About
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.grid import Grid
from wrenchflow.datasets.increments import increments
from wrenchflow.datasets.masks import Member, masks_of
from wrenchflow.datasets.parts import valid_parts
from wrenchflow.datasets.pictures import decode, decode_all
from wrenchflow.datasets.sample import SAMPLED, STREAMS, sample
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import DatasetError
from wrenchflow.recording.images import image_messages, jpeg
from wrenchflow.signals import JOINTS, POSE, TWIST, WRENCH

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
SIGNALS = {"joint_states": JOINTS, "tcp_twist": TWIST, "wrench": WRENCH}


def stream(rng: np.random.Generator, name: str, n: int) -> Stream:
    signal = SIGNALS.get(name, POSE)
    data = rng.normal(size=(n, signal.width))
    if signal is POSE:
        data[:, 3:] /= np.linalg.norm(data[:, 3:], axis=1, keepdims=True)
    return Stream(START_NS + np.arange(n, dtype=np.int64) * MS, data, signal)


@pytest.fixture
def episode() -> Episode:
    """Two seconds at 1 kHz."""
    rng = np.random.default_rng(0)
    streams = {name: stream(rng, name, 1 if name == "goal_pose" else 2000) for name in STREAMS}
    return Episode("0007", "peg", streams, (), {"result": {"success": True}, "person": {"profile": "expert"}})


def without(episode: Episode, name: str, first_ms: int, last_ms: int) -> Episode:
    """The episode with samples lost after `first_ms`, until `last_ms`."""
    whole = episode[name]
    kept = (whole.t <= START_NS + first_ms * MS) | (whole.t >= START_NS + last_ms * MS)
    return episode.with_stream(name, replace(whole, t=whole.t[kept], data=whole.data[kept]))


def ms(steps) -> list[int]:
    return [int(t - START_NS) // MS for t in steps.t]


class TestGaps:
    def test_a_gap_divides_an_episode_and_nothing_of_it_is_held(self, episode):
        whole = sample(episode, Grid())[0]
        before, after = sample(without(episode, "tcp_pose", 500, 570), Grid())
        assert (before.episode_id, after.episode_id) == ("0007.0", "0007.1")
        assert before.recording_id == after.recording_id == whole.recording_id == "0007"
        assert ms(before) == list(range(0, 501, 50))
        assert ms(after) == list(range(600, 1901, 50))
        for part in (before, after):
            rows = np.isin(whole.t, part.t)
            for name, values in part.observations.items():
                np.testing.assert_array_equal(values, whole.observations[name][rows])
            np.testing.assert_array_equal(part.actions, whole.actions[rows])

    def test_a_gap_in_the_wrench_takes_the_steps_whose_windows_it_is_in(self, episode):
        before, after = sample(without(episode, "wrench", 500, 530), Grid())
        assert ms(before)[-1] == 500
        # A window may look back 150 ms.
        assert ms(after)[0] == 700

    def test_a_gap_in_the_target_takes_the_step_before(self, episode):
        before, after = sample(without(episode, "target_pose", 520, 560), Grid())
        assert (ms(before)[-1], ms(after)[0]) == (450, 550)

    def test_twenty_lost_ticks_are_no_gap(self, episode):
        assert len(sample(without(episode, "wrench", 500, 520), Grid())) == 1

    def test_marked_steps_are_held_from_the_step_before_and_say_so(self, episode):
        whole = sample(episode, Grid())[0]
        (marked,) = sample(without(episode, "tcp_pose", 490, 620), Grid(gaps="mark"))
        np.testing.assert_array_equal(marked.t, whole.t)
        bad = ~marked.valid["tcp_pose"]
        assert [int(t - START_NS) // MS for t in marked.t[bad]] == [500, 550, 600]
        assert all(marked.valid[name].all() for name in SAMPLED if name != "tcp_pose")
        pose = marked.observations["tcp_pose"]
        np.testing.assert_array_equal(pose[~bad], whole.observations["tcp_pose"][~bad])
        np.testing.assert_array_equal(pose[bad], pose[[9, 9, 9]])
        np.testing.assert_array_equal(marked.observations["wrench"], whole.observations["wrench"])
        assert marked.skew_ns["tcp_pose"][bad].tolist() == [10 * MS, 60 * MS, 110 * MS]

    def test_a_policy_learns_from_none_of_the_marked_steps(self, episode):
        (marked,) = sample(without(episode, "tcp_pose", 490, 620), Grid(gaps="mark"))
        split = sample(without(episode, "tcp_pose", 490, 620), Grid())
        for part, other in zip(valid_parts(marked), split, strict=True):
            assert (part.episode_id, part.recording_id) == (other.episode_id, "0007")
            np.testing.assert_array_equal(part.t, other.t)
            np.testing.assert_array_equal(part.actions, other.actions)
            for name in part.observations:
                np.testing.assert_array_equal(part.observations[name], other.observations[name])

    def test_a_gap_may_be_refused(self, episode):
        with pytest.raises(DatasetError, match=r"episode 0007: stream 'tcp_pose' has no sample for 130\.0 ms"):
            sample(without(episode, "tcp_pose", 490, 620), Grid(gaps="refuse"))

    def test_an_episode_that_is_all_gaps_is_refused(self, episode):
        sparse = episode["wrench"].t % (50 * MS) == 0
        few = replace(episode["wrench"], t=episode["wrench"].t[sparse], data=episode["wrench"].data[sparse])
        late = replace(episode["tcp_pose"], t=episode["tcp_pose"].t[10:], data=episode["tcp_pose"].data[10:])
        episode = episode.with_stream("tcp_pose", late)
        for gaps in ("split", "mark"):
            with pytest.raises(DatasetError, match=r"episode 0007: a gap lies at each of its \d+ steps"):
                sample(episode.with_stream("wrench", few), Grid(gaps=gaps))


class TestGrids:
    @pytest.mark.parametrize("rate_hz", [Fraction(30), Fraction(30000, 1001), Fraction(25, 2)])
    def test_no_rate_drifts(self, rate_hz):
        t = Grid(rate_hz=rate_hz).times(START_NS, START_NS + 3600 * 1000 * MS)
        for k in (0, 1, len(t) // 2, len(t) - 1):
            assert abs(int(t[k]) - (START_NS + k * 1_000_000_000 / rate_hz)) <= Fraction(1, 2)
        assert t[-1] <= START_NS + 3600 * 1000 * MS < t[-1] + 1_000_000_000 / rate_hz

    def test_steps_lie_where_a_camera_took_its_pictures(self, episode):
        rng = np.random.default_rng(1)
        t = START_NS + 7 * MS + (np.arange(60) * 33.3 * MS + rng.uniform(-2, 2, 60) * MS).astype(np.int64)
        seen = with_pictures(episode, "wrist", np.delete(t, 20))
        parts = sample(seen, Grid(rate_hz=Fraction(30), camera="wrist", cameras=("wrist",)))
        # A picture that is missing divides the episode; the step before it would reach over the hole.
        assert [len(part) for part in parts] == [19, 38]
        np.testing.assert_array_equal(np.concatenate([part.t for part in parts]), np.delete(t, [19, 20, 59]))
        assert all((part.skew_ns["camera/wrist"] == 0).all() for part in parts)
        assert [brightness(picture) for picture in parts[1].pictures["wrist"][:3]] == [63, 66, 69]

    def test_pictures_are_the_last_that_were_taken(self, episode):
        t = START_NS + np.arange(0, 2000, 30, dtype=np.int64) * MS
        (steps,) = sample(with_pictures(episode, "wrist", t), Grid(cameras=("wrist",)))
        shown = [brightness(picture) // 3 for picture in steps.pictures["wrist"]]
        assert shown == [int(at - START_NS) // (30 * MS) for at in steps.t]
        np.testing.assert_array_equal(steps.skew_ns["camera/wrist"], (steps.t - START_NS) % (30 * MS))

    def test_a_camera_that_stops_divides_the_episode(self, episode):
        t = START_NS + np.arange(0, 2000, 30, dtype=np.int64) * MS
        parts = sample(with_pictures(episode, "wrist", np.delete(t, range(20, 25))), Grid(cameras=("wrist",)))
        assert [ms(parts[0])[-1], ms(parts[1])[0]] == [600, 750]

    def test_a_camera_that_is_not_there_is_named(self, episode):
        seen = with_pictures(episode, "wrist", episode["wrench"].t[::30])
        with pytest.raises(DatasetError, match=r"no pictures of camera 'scene'\. There are those of: wrist"):
            sample(seen, Grid(cameras=("scene",)))


def with_pictures(episode: Episode, camera: str, t: np.ndarray) -> Episode:
    """With pictures whose brightness counts them; one that is missing leaves a number out."""
    numbers = np.rint((t - t[0]) / np.median(np.diff(t))).astype(int)
    made = [jpeg(np.full((24, 32, 3), 3 * i, np.uint8)) for i in range(numbers[-1] + 1)]
    return replace(
        episode, messages={f"camera/{camera}": image_messages(t, [made[i] for i in numbers], f"camera/{camera}")}
    )


def brightness(picture: bytes) -> int:
    return int(np.median(decode(picture)))


def test_pictures_are_brought_to_size_by_the_mean():
    pixels = np.zeros((40, 80, 3), np.uint8)
    pixels[:, 40:] = 200
    out = decode_all([jpeg(pixels)] * 2, (20, 20))
    assert out.shape == (2, 20, 20, 3)
    assert (np.abs(out[0, :, :9].astype(int)) < 6).all()
    assert (np.abs(out[0, :, 11:].astype(int) - 200) < 6).all()
    with pytest.raises(DatasetError, match="a picture of 3 bytes cannot be read"):
        decode(b"abc")


def test_an_increment_leads_from_the_tool_to_its_target():
    rng = np.random.default_rng(3)
    pose = np.concatenate([rng.normal(size=(50, 3)), rng.normal(size=(50, 4))], axis=1)
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    turn = rng.normal(0.0, 0.5, (50, 3))
    target = Rotation.from_rotvec(turn) * Rotation.from_quat(pose[:, 3:], scalar_first=True)
    matrix = target.as_matrix()
    actions = np.concatenate([pose[:, :3] + 0.01, matrix[:, :, 0], matrix[:, :, 1]], axis=1)
    made = increments(pose.astype(np.float32), actions.astype(np.float32))
    np.testing.assert_allclose(made[:, :3], 0.01, atol=1e-6)
    np.testing.assert_allclose(made[:, 3:], turn, atol=1e-5)


def test_parts_of_a_recording_are_on_one_side_of_every_split():
    members = [
        Member(recording_id=f"{i // 3:04d}", task="a b/c" if i % 2 else "peg", operator="x" if i < 9 else "")
        for i in range(30)
    ]
    about = About(config=ExportConfig(valid_fraction=0.3), masks={"gentle": {"0001", "0002"}})
    masks = masks_of(members, about)
    assert sorted(masks["train"] + masks["valid"]) == list(range(30))
    assert {members[i].recording_id for i in masks["train"]}.isdisjoint(members[i].recording_id for i in masks["valid"])
    assert len({members[i].recording_id for i in masks["valid"]}) == 3
    assert masks["task_a_b_c"] == tuple(range(1, 30, 2))
    assert masks["operator_x"] == tuple(range(9))
    assert masks["gentle"] == tuple(range(3, 9))
    for name in ("task_a_b_c", "operator_x", "gentle"):
        assert sorted(masks[f"{name}_train"] + masks[f"{name}_valid"]) == list(masks[name])
