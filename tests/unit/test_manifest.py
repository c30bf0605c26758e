import json
from pathlib import Path

import pytest

from wrenchflow.control.config import ControlConfig
from wrenchflow.errors import OutputError, RecordingError
from wrenchflow.manifest import output_folder, read_manifest, sha256_of, write_json, write_manifest


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_a_folder_is_partial_until_it_is_whole(tmp_path: Path):
    out = tmp_path / "runs" / "out"
    with output_folder(out) as folder:
        (folder / "a.txt").write_text("1")
        assert folder.name == "out.partial"
        assert not out.exists()
    assert names(tmp_path / "runs") == ["out", "out/a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_what_goes_wrong_leaves_only_the_partial_folder(tmp_path: Path, error: type[BaseException]):
    out = tmp_path / "out"

    def write() -> None:
        with output_folder(out) as folder:
            (folder / "a.txt").write_text("1")
            raise error

    with pytest.raises(error):
        write()
    assert names(tmp_path) == ["out.partial", "out.partial/a.txt"]
    with output_folder(out) as folder:  # The next attempt starts afresh.
        (folder / "b.txt").write_text("2")
    assert names(tmp_path) == ["out", "out/b.txt"]


def test_a_folder_that_is_there_is_refused_and_left_alone(tmp_path: Path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "manifest.json").write_text("1")
    with pytest.raises(OutputError, match=r"exists already. Choose another place, or pass --overwrite\.$"):
        output_folder(out).__enter__()
    with pytest.raises(OutputError, match=r"Choose another place, pass --resume to go on with it, or pass --overwrite"):
        output_folder(out, resume=False).__enter__()
    assert names(tmp_path) == ["out", "out/manifest.json"]


@pytest.mark.parametrize("resume", [None, False, True])
def test_an_empty_folder_is_as_good_as_none(tmp_path: Path, resume: bool | None):
    (tmp_path / "out").mkdir()
    with output_folder(tmp_path / "out", resume=resume) as folder:
        (folder / "a.txt").write_text("1")
    assert names(tmp_path) == ["out", "out/a.txt"]


def test_an_old_folder_goes_only_when_the_new_one_is_whole(tmp_path: Path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "old.txt").write_text("1")
    (out / "manifest.json").write_text("{}")
    with pytest.raises(ValueError), output_folder(out, overwrite=True):
        raise ValueError
    assert (out / "old.txt").exists()
    with output_folder(out, overwrite=True) as folder:
        (folder / "new.txt").write_text("2")
        assert (out / "old.txt").exists()
    assert names(tmp_path) == ["out", "out/new.txt"]


def test_a_place_that_cannot_be_made_is_one_known_error(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        output_folder(tmp_path / "file" / "out").__enter__()


def test_a_manifest_says_what_made_the_folder_and_nothing_of_when_or_where(tmp_path: Path):
    data = tmp_path / "in.mcap"
    data.write_bytes(b"abc")
    write_manifest(tmp_path, "process", ControlConfig(), inputs=[data], seed=7)
    manifest = read_manifest(tmp_path)
    assert manifest["stage"] == "process"
    assert manifest["seed"] == 7
    assert manifest["config"]["force_max_n"] == ControlConfig().force_max_n
    assert manifest["inputs"] == {"in.mcap": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"}
    assert sha256_of(data) == manifest["inputs"]["in.mcap"]
    assert set(manifest) == {"stage", "config", "seed", "versions", "inputs"}
    assert str(tmp_path) not in (tmp_path / "manifest.json").read_text()
    first = (tmp_path / "manifest.json").read_bytes()
    write_manifest(tmp_path, "process", ControlConfig(), inputs=[data], seed=7)
    assert (tmp_path / "manifest.json").read_bytes() == first


def test_json_that_cannot_be_written_leaves_the_old_file(tmp_path: Path):
    write_json(tmp_path / "a.json", {"x": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"x": float("nan")})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 1}


def test_a_manifest_that_is_missing_or_damaged_is_one_known_error(tmp_path: Path):
    with pytest.raises(RecordingError, match="does not exist"):
        read_manifest(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(RecordingError, match="cannot be read as JSON"):
        read_manifest(tmp_path)


def test_only_a_folder_of_ours_is_ever_replaced(tmp_path: Path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "thesis.txt").write_text("1")
    (tmp_path / "file").write_text("2")
    for name, said in (("precious", "is no folder that wrenchflow made"), ("file", "is a file")):
        with pytest.raises(OutputError, match=said):
            output_folder(tmp_path / name, overwrite=True).__enter__()
    assert names(tmp_path) == ["file", "precious", "precious/thesis.txt"]


def test_what_is_read_is_never_replaced(tmp_path: Path):
    run = tmp_path / "run"
    run.mkdir()
    (run / "manifest.json").write_text("{}")
    for out in (run, tmp_path):
        with pytest.raises(OutputError, match=r"would replace what is read"):
            output_folder(out, overwrite=True, reads=[run]).__enter__()
    assert names(tmp_path) == ["run", "run/manifest.json"]


def test_the_folder_that_one_is_in_is_never_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "manifest.json").write_text("{}")
    monkeypatch.chdir(tmp_path / "sub")
    for out in (Path("."), Path(".."), Path("")):
        with pytest.raises(OutputError, match="the folder that this runs in"):
            output_folder(out, overwrite=True).__enter__()
    assert names(tmp_path) == ["manifest.json", "sub"]


def test_two_runs_never_write_into_one_folder(tmp_path: Path):
    with output_folder(tmp_path / "out") as folder:
        (folder / "a.txt").write_text("1")
        with pytest.raises(OutputError, match="is being written by another run"):
            output_folder(tmp_path / "out").__enter__()
        assert (folder / "a.txt").exists()
    assert names(tmp_path) == ["out", "out/a.txt"]
