"""What a person reads whose mapping or file cannot be imported, as import_errors.toml has it; no folder is left."""

import tomllib
from pathlib import Path

import pytest

from wrenchflow.errors import WrenchflowError
from wrenchflow.imports.import_folder import import_folder
from wrenchflow.recording.reader import read_episode

CASES = tomllib.loads((Path(__file__).parent / "import_errors.toml").read_text())
MAPPING = """task = "press"
rig = "panda_peg"

[file]
delimiter = ","

[clock]
stamps = "t"
unit = "s"

[streams.wrench_raw]
force = { columns = ["fx", "fy", "fz"], unit = "N" }
moment = { columns = ["mx", "my", "mz"], unit = "N.m" }
frame = "sensor"
sign = "robot-on-environment"

[streams.tcp_pose]
position = { columns = ["x", "y", "z"], unit = "mm" }
orientation = { columns = ["q1", "q2", "q3", "q4"], order = "xyzw" }
frame = "base"
"""
TABLE = """t,fx,fy,fz,mx,my,mz,x,y,z,q1,q2,q3,q4
0.00,1,2,-2,0,0,0,100,200,300,0,0,0,1
0.01,1,2,-2.5,0,0,0,100,200,300,0,0,0,1
0.02,1,2,-3,0,0,0,100,200,300,0,0,0,1
"""


def changed(text: str, pairs: list[list[str]]) -> str:
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def do(folder: Path, case: dict) -> None:
    (folder / "log.toml").write_text(changed(MAPPING, case.get("mapping", [])))
    (folder / "log.csv").write_text(changed(TABLE, case.get("table", [])))
    (folder / "broken.mat").write_text("this is no MATLAB file" * 20)
    (folder / "empty").mkdir()
    list(import_folder(Path("log.toml"), Path("out"), [Path(file) for file in case.get("files", ["log.csv"])]))


def test_what_is_changed_is_fine_before_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    do(tmp_path, {})
    assert read_episode(tmp_path / "out" / "log.mcap")["tcp_pose"].data[0].tolist() == [0.1, 0.2, 0.3, 1, 0, 0, 0]


@pytest.mark.parametrize("name", CASES)
def test_what_cannot_be_imported_is_told_in_one_line(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WrenchflowError) as raised:
        do(tmp_path, CASES[name])
    assert str(raised.value) == CASES[name]["says"]
    assert not (tmp_path / "out").exists()
