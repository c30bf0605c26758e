"""A disk that is full while a data set is written: one line, exit code 1, and nothing that looks whole."""

import subprocess
import sys

import pytest

# A file that may grow to 60 kB only stands for the disk: the same errors come from the same calls.
_CHILD = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
from wrenchflow import cli
sys.exit(cli.main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stage", "written"),
    [
        (("export", "robomimic"), "robomimic.hdf5"),
        (("export", "lerobot"), "lerobot"),
        (("export", "zarr"), "replay_buffer.zarr"),
        (("export", "parquet"), "steps.parquet"),
        (("export", "csv"), "steps.csv"),
        (("analyze",), ""),
    ],
)
def test_a_full_disk_is_said_in_one_line(stage, written, chain, tmp_path):
    out = tmp_path / "out"
    arguments = [*stage, str(chain.folder / "clean"), str(out), "--jobs", "1"]
    ran = subprocess.run([sys.executable, "-c", _CHILD, *arguments], capture_output=True, text=True)
    assert ran.returncode == 1
    assert len(ran.stderr.strip().splitlines()) == 1, ran.stderr
    assert "cannot be written" in ran.stderr
    assert "File too large" in ran.stderr
    assert not (out / written).exists()
    assert not list(tmp_path.rglob("*manifest.json"))
