"""The same seed twice, on one worker and on two: equal bytes in raw, clean and HDF5.

uv run python benchmarks/same_bytes.py
"""

import tempfile
from pathlib import Path

from wrenchflow.cli import main as wrenchflow
from wrenchflow.manifest import sha256_of

EPISODES = 8


def run(out: Path, jobs: int) -> dict[str, str]:
    """Collect, process and export once; hashes of all recordings and of the HDF5 file, by relative path."""
    raw, clean, data = str(out / "raw"), str(out / "clean"), str(out / "data")
    workers = ["--jobs", str(jobs)]
    for command in (
        ["collect", raw, "--episodes", str(EPISODES), "--seed", "7", *workers],
        ["process", raw, clean, *workers],
        ["export", "robomimic", clean, data, *workers],
    ):
        if wrenchflow(command) != 0:
            raise SystemExit(f"'{' '.join(command)}' failed")
    files = [*out.rglob("*.mcap"), *out.rglob("*.hdf5")]
    return {str(path.relative_to(out)): sha256_of(path) for path in sorted(files)}


def main() -> None:
    """Compare the two runs file by file."""
    with tempfile.TemporaryDirectory() as folder:
        first, second = run(Path(folder) / "one", 1), run(Path(folder) / "two", 2)
    same = sum(first[name] == second.get(name) for name in first)
    print(f"{same} of {len(first)} files have equal bytes ({EPISODES} episodes raw and clean, one HDF5)")
    if same != len(first) or first.keys() != second.keys():
        raise SystemExit(1)


if __name__ == "__main__":
    main()
