"""A cluster gives what this machine gives, also when a worker dies, and an address that leads nowhere is refused."""

from functools import partial
from pathlib import Path

import pytest

from cluster.deaths import die_always, die_at_first
from wrenchflow.cluster import executor_at
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, WorkerError
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_folder
from wrenchflow.recording.write import write_episode


@pytest.mark.parametrize("address", ["localhost:8786", "dask://", "dask://host", "dask://host:port", "tcp://a:1"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(ConfigError, match=r"expected dask://HOST:PORT"), executor_at(address):
        pass


def test_without_an_address_the_work_stays_here():
    with executor_at(None) as executor:
        assert executor is None


@pytest.fixture
def cluster():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        worker_dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        yield cluster


def address_of(cluster) -> str:
    return cluster.scheduler_address.replace("tcp://", "dask://")


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(filter(Path.is_file, folder.rglob("*")))}


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_cluster_makes_the_same_bytes(cluster, recording, tmp_path: Path):
    raw = tmp_path / "raw"
    raw.mkdir()
    for i in range(4):
        write_episode(raw / f"{i:04}.mcap", recording(id=f"{i:04}", seed=i))
    here = list(process_folder(raw, tmp_path / "here", ProcessConfig()))
    with executor_at(address_of(cluster)) as executor:
        there = list(process_folder(raw, tmp_path / "there", ProcessConfig(), executor=executor))
    assert there == here
    assert files(tmp_path / "there") == files(tmp_path / "here")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_worker_that_is_killed_loses_nothing(cluster, tmp_path: Path):
    with executor_at(address_of(cluster)) as executor:
        got = list(map_episodes(partial(die_at_first, tmp_path), range(12), executor=executor))
    assert got == [item * item for item in range(12)]
    assert len(list(tmp_path.iterdir())) == 12


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_workers_that_die_again_and_again_are_an_error(cluster):
    with pytest.raises(WorkerError, match="again and again"), executor_at(address_of(cluster)) as executor:
        list(map_episodes(die_always, [1], executor=executor))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_nobody_at_an_address_is_said():
    with (
        pytest.raises(ConfigError, match=r"no Dask scheduler answers at '127.0.0.1:1'"),
        executor_at("dask://127.0.0.1:1"),
    ):
        pass
