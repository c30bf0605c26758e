"""Arrays of one value a step, to and from Arrow's columns as LeRobot lays them out."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from wrenchflow.errors import DatasetError


def array_of(values: np.ndarray) -> pa.Array:
    """A column: numbers, lists of a fixed size, or, of more dimensions, lists of lists."""
    if values.ndim == 1:
        return pa.array(values)
    flat = pa.array(np.ascontiguousarray(values).ravel())
    if values.ndim == 2:
        return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    for length in reversed(values.shape[1:]):
        flat = pa.ListArray.from_arrays(np.arange(0, len(flat) + 1, length, dtype=np.int32), flat)
    return flat


def values_of(column: Any, what: str = "the column") -> np.ndarray:
    """The values of a column. Shape (T, ...).

    Args:
        column: An array, or one in chunks.
        what: What it is, for the message.

    Raises:
        DatasetError: If its rows differ in length, or values are missing.
    """
    flat = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    shape = [len(flat)]
    while pa.types.is_list(flat.type) or pa.types.is_fixed_size_list(flat.type) or pa.types.is_large_list(flat.type):
        if flat.null_count:
            raise DatasetError(f"{what}: {flat.null_count} rows are missing.")
        if pa.types.is_fixed_size_list(flat.type):
            lengths = [flat.type.list_size]
        else:
            lengths = pc.call_function("list_value_length", [flat]).unique().to_pylist()
        if len(lengths) > 1:
            raise DatasetError(
                f"{what}: rows have {', '.join(map(str, sorted(lengths)))} values, expected as many in each."
            )
        shape.append(lengths[0] if lengths else 0)
        flat = flat.flatten()
    if flat.null_count:
        raise DatasetError(f"{what}: {flat.null_count} values are missing.")
    return flat.to_numpy(zero_copy_only=False).reshape(shape)
