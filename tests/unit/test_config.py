from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from wrenchflow.config import from_mapping, load, read_toml, to_mapping
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Filter:
    cutoff_hz: float = 40.0
    order: int = 4


@dataclass(frozen=True, kw_only=True)
class Stage:
    name: str
    filter: Filter = field(default_factory=Filter)
    kind: Literal["fast", "slow"] = "fast"
    limits_n: tuple[float, ...] = (1.0,)
    corner_m: tuple[float, float] = (0.0, 0.0)
    weights: dict[str, float] = field(default_factory=dict)
    folder: Path | None = None
    strict: bool = True


def test_plain_values_become_the_dataclass_and_come_back():
    values = {
        "name": "a",
        "filter": {"cutoff_hz": 20, "order": 2},
        "kind": "slow",
        "limits_n": [1, 2.5, 3],
        "corner_m": [0.5, 1],
        "weights": {"x": 2},
        "folder": "out",
        "strict": False,
    }
    stage = from_mapping(Stage, values)
    assert stage == Stage(
        name="a",
        filter=Filter(cutoff_hz=20.0, order=2),
        kind="slow",
        limits_n=(1.0, 2.5, 3.0),
        corner_m=(0.5, 1.0),
        weights={"x": 2.0},
        folder=Path("out"),
        strict=False,
    )
    assert isinstance(stage.filter.cutoff_hz, float)
    assert from_mapping(Stage, to_mapping(stage)) == stage
    assert from_mapping(Stage, to_mapping(Stage(name="b"))) == Stage(name="b")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"name": "a", "filter": {"cutof_hz": 1.0}},
            "config.filter: unknown key 'cutof_hz'. Did you mean 'cutoff_hz'? Available: cutoff_hz, order.",
        ),
        (
            {},
            "config: key 'name' is missing. Expected: name, filter, kind, limits_n, corner_m, weights, folder, strict.",
        ),
        ({"name": 3}, "config.name: expected str, got 3."),
        ({"name": "a", "filter": 3}, "config.filter: expected a table of Filter, got 3."),
        ({"name": "a", "filter": {"order": 1.5}}, "config.filter.order: expected int, got 1.5."),
        ({"name": "a", "filter": {"order": True}}, "config.filter.order: expected int, got True."),
        ({"name": "a", "filter": {"cutoff_hz": True}}, "config.filter.cutoff_hz: expected float, got True."),
        ({"name": "a", "strict": 1}, "config.strict: expected bool, got 1."),
        ({"name": "a", "kind": "slo"}, "config.kind: unknown value 'slo'. Did you mean 'slow'? Available: fast, slow."),
        ({"name": "a", "limits_n": 1.0}, "config.limits_n: expected a list, got 1.0."),
        ({"name": "a", "limits_n": [1.0, "x"]}, "config.limits_n[1]: expected float, got 'x'."),
        ({"name": "a", "corner_m": [1.0]}, "config.corner_m: expected 2 values, got 1."),
        ({"name": "a", "weights": [1.0]}, "config.weights: expected a table, got [1.0]."),
        ([], "config: expected a table of Stage, got []."),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(values, message):
    with pytest.raises(ConfigError) as error:
        from_mapping(Stage, values)
    assert str(error.value) == message


def test_a_file_is_named_in_the_message(tmp_path: Path):
    path = tmp_path / "stage.toml"
    path.write_text('name = "a"\nfolders = "x"\n')
    with pytest.raises(ConfigError, match=r"^stage.toml: unknown key 'folders'. Did you mean 'folder'\?"):
        load(Stage, path)
    path.write_text('name = "a"\n[filter]\ncutoff_hz = 1e-3\n')
    assert load(Stage, path).filter.cutoff_hz == 1e-3


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe"])
def test_a_file_that_cannot_be_read_is_one_known_error(tmp_path: Path, content: bytes):
    path = tmp_path / "stage.toml"
    with pytest.raises(ConfigError, match="does not exist"):
        read_toml(path)
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="cannot be read as TOML"):
        read_toml(path)
    with pytest.raises(ConfigError, match="cannot be read as TOML"):
        read_toml(tmp_path)
