"""MATLAB files are read to what scipy reads in them; damaged ones are told, whatever the damage is."""

import struct
import tomllib
import zlib

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from wrenchflow.config import from_mapping
from wrenchflow.errors import RecordingError
from wrenchflow.imports.mapping import FileLayout, Values
from wrenchflow.imports.matlab import read_matlab
from wrenchflow.imports.matlab_file import StructArray, read_variables

_RNG = np.random.default_rng(5)
TYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def values() -> dict:
    arrays = {f"a_{kind}": (50 * _RNG.normal(size=(3, 7))).astype(kind) for kind in TYPES}
    fields = np.empty((2, 2), [("F", "O"), ("name", "O"), ("empty", "O")])
    for k in range(4):
        fields.flat[k] = (_RNG.normal(size=(3, 5 + k)), "take", np.empty((0, 3)))
    return {**arrays, "scalar": 2.5, "cube": _RNG.normal(size=(2, 3, 4)), "runs": fields, "empty": np.empty((0, 0))}


@pytest.mark.parametrize("is_compressed", [False, True])
def test_variables_are_what_scipy_reads(tmp_path, is_compressed):
    path = tmp_path / "a.mat"
    savemat(path, values(), do_compression=is_compressed)
    expected, found = loadmat(path), read_variables(path)
    assert set(found) == set(values())
    runs = found.pop("runs")
    for name, array in found.items():
        assert isinstance(array, np.ndarray)
        np.testing.assert_array_equal(array, expected[name])
        assert array.shape == expected[name].shape
    assert isinstance(runs, StructArray)
    for fields, theirs in zip(runs.elements, expected["runs"].ravel(order="F"), strict=True):
        np.testing.assert_array_equal(fields["F"], theirs["F"])
        assert fields["name"] is None


def test_what_is_no_array_of_real_numbers_is_none(tmp_path):
    path = tmp_path / "a.mat"
    cell = np.empty(2, object)
    cell[:] = ["a", 1.0]
    savemat(path, {"text": "hello", "cell": cell, "complex": np.array([1.0 + 2.0j]), "deep": {"in": {"to": 1.0}}})
    found = read_variables(path)
    assert [found[name] for name in ("text", "cell", "complex")] == [None] * 3
    deep = found["deep"]
    assert isinstance(deep, StructArray)
    assert deep.elements == ({"in": None},)


def test_a_file_of_the_other_byte_order_is_read(tmp_path):
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(">II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    parts = element(6, struct.pack(">II", 6, 0)) + element(5, struct.pack(">ii", 2, 3)) + element(1, b"f")
    matrix = element(14, parts + element(9, struct.pack(">6d", *range(6))))
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0".ljust(124) + struct.pack(">H", 0x0100) + b"MI" + matrix)
    assert read_variables(tmp_path / "a.mat")["f"].tolist() == [[0, 2, 4], [1, 3, 5]]  # Column by column.


@pytest.mark.parametrize("is_compressed", [False, True])
def test_damage_is_told(tmp_path, is_compressed):
    path, rng = tmp_path / "a.mat", np.random.default_rng(0)
    savemat(path, values(), do_compression=is_compressed)
    whole, told = path.read_bytes(), 0
    for k in range(200):
        content = bytearray(whole)
        if k % 2:
            content = content[: rng.integers(0, len(content))]
        else:
            for at in rng.integers(0, len(content), 5):
                content[at] = rng.integers(0, 256)
        path.write_bytes(content)
        try:
            read_variables(path)
        except RecordingError:
            told += 1
    assert told > 100


def test_a_variable_that_unpacks_to_more_than_it_may_is_refused(tmp_path):
    packer = zlib.compressobj()
    bomb = b"".join([*(packer.compress(bytes(2**20)) for _ in range(200)), packer.flush()])
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    (tmp_path / "a.mat").write_bytes(header + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(RecordingError, match="takes more than 134217728 bytes"):
        read_variables(tmp_path / "a.mat")


def test_a_newer_version_says_how_to_save_it(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3".ljust(124) + struct.pack("<H", 0x0200) + b"IM")
    with pytest.raises(RecordingError, match=r"is of MATLAB 7\.3, expected version 5 to 7: save it with '-v7'"):
        read_variables(tmp_path / "a.mat")


@pytest.mark.parametrize(
    ("part", "shape", "expected"),
    [
        ('variable = "a"', (3, 9), "columns"),
        ('variable = "a"', (9, 3), "rows"),
        ('variable = "a", samples = "columns"', (3, 3), "columns"),
        ('variable = "a", samples = "rows"', (3, 3), "rows"),
        ('variable = "a", samples = "rows", pick = [4, 5, 6]', (9, 6), "rows, picked"),
        ('variable = "a"', (3, 3), "state whether its samples are 'rows' or 'columns'"),
        ('variable = "a", pick = [4, 5, 6]', (6, 9), "state whether its samples are 'rows' or 'columns'"),
        ('variable = "a", samples = "rows", pick = [4, 5, 7]', (9, 6), "has 6 channels, picked 7"),
        ('variable = "a"', (4, 9), "is 4 x 9, expected 3 channels"),
        ('variable = "b"', (3, 9), "unknown variable of .* 'b'"),
        ('variable = "a"', (3, 3, 3), "has 3 dimensions, expected 2"),
    ],
)
def test_which_way_an_array_lies_is_told_by_its_shape_or_stated(tmp_path, part, shape, expected):
    array = _RNG.normal(size=shape)
    savemat(tmp_path / "a.mat", {"a": array})
    said = from_mapping(Values, tomllib.loads(f"part = {{ {part} }}")["part"])
    (take,) = read_matlab(tmp_path / "a.mat", FileLayout())
    lies = {"columns": array.T, "rows": array, "rows, picked": array[:, 3:] if array.ndim == 2 else array}
    if expected in lies:
        np.testing.assert_array_equal(take.numbers(said, 3, "force"), lies[expected])
    else:
        with pytest.raises(RecordingError, match=expected):
            take.numbers(said, 3, "force")
