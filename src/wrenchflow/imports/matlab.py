"""MATLAB files up to version 7: variables, or a struct array with an episode in each of its elements."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import RecordingError, unknown
from wrenchflow.imports.mapping import Clock, FileLayout, Values
from wrenchflow.imports.matlab_file import StructArray, Variable, read_variables
from wrenchflow.imports.stamps import to_ns
from wrenchflow.imports.take import TopicRows


class Struct:
    """The variables of a MATLAB file, or the fields of one element of a struct array."""

    def __init__(self, id: str, path: Path, variables: Mapping[str, Variable]) -> None:
        """Take them as they are."""
        self.id, self._path, self._variables = id, path, variables

    def numbers(self, part: Values, width: int | None, where: str) -> Float[np.ndarray, "n k"]:
        """See `Take`."""
        if part.columns:
            raise RecordingError(f"{where}: {self._path} has no columns: its variable has to be stated.")
        array = self._array(part.variable, where)
        if array.ndim != 2:
            raise RecordingError(f"{where}: '{part.variable}' of {self._path} has {array.ndim} dimensions, expected 2.")
        rows = array.T if self._has_samples_in_columns(array, part, width, where) else array
        if part.pick:
            if max(part.pick) > rows.shape[1]:
                raise RecordingError(
                    f"{where}: '{part.variable}' of {self._path} has {rows.shape[1]} channels, picked {max(part.pick)}."
                )
            rows = rows[:, [channel - 1 for channel in part.pick]]
        return np.ascontiguousarray(rows, np.float64)

    def stamps(self, clock: Clock, where: str) -> Int64[np.ndarray, " n"]:
        """See `Take`."""
        assert clock.unit is not None  # The mapping was checked.
        values = self._array(clock.stamps, where).ravel().tolist()
        return to_ns(values, clock.unit, f"{self._path}: '{clock.stamps}'")

    def topic(self, name: str, where: str) -> TopicRows:
        """See `Take`."""
        raise RecordingError(f"{where}: {self._path} is a MATLAB file and has no topic '{name}'.")

    def _array(self, name: str, where: str) -> np.ndarray:
        if name not in self._variables:
            raise RecordingError(f"{where}: {unknown(f'variable of {self._path}', name, self._variables)}")
        array = self._variables[name]
        if not isinstance(array, np.ndarray):
            raise RecordingError(f"{where}: '{name}' of {self._path} holds no real numbers.")
        return array

    def _has_samples_in_columns(self, array: np.ndarray, part: Values, width: int | None, where: str) -> bool:
        if part.samples is not None:
            return part.samples == "columns"
        shape = f"'{part.variable}' of {self._path} is {array.shape[0]} x {array.shape[1]}"
        if width is None or part.pick:
            raise RecordingError(f"{where}: {shape}: state whether its samples are 'rows' or 'columns'.")
        fits = [size == width for size in array.shape]
        if not any(fits):
            raise RecordingError(f"{where}: {shape}, expected {width} channels.")
        if all(fits):
            raise RecordingError(f"{where}: {shape}: state whether its samples are 'rows' or 'columns'.")
        return fits[0]


def read_matlab(path: Path, layout: FileLayout) -> tuple[Struct, ...]:
    """Read a MATLAB file.

    Raises:
        RecordingError: If it is missing, damaged or too new, or has no such struct array.
    """
    variables = read_variables(path)
    if not layout.takes:
        return (Struct(path.stem, path, variables),)
    if layout.takes not in variables:
        raise RecordingError(f"file.takes: {unknown(f'variable of {path}', layout.takes, variables)}")
    takes = variables[layout.takes]
    if not isinstance(takes, StructArray):
        raise RecordingError(f"file.takes: '{layout.takes}' of {path} is no struct array.")
    digits = len(str(len(takes.elements)))
    return tuple(
        Struct(f"{path.stem}-{number:0{digits}d}", path, fields) for number, fields in enumerate(takes.elements, 1)
    )
