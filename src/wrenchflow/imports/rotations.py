"""Orientations of others, as quaternions in our order."""

from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

QUATERNIONS = ("wxyz", "xyzw")
EULER = tuple("".join(axes) for axes in product("XYZ", repeat=3) if axes[0] != axes[1] and axes[1] != axes[2])


def is_stated(order: str, axes: str | None) -> bool:
    """Whether an order, one of those above or empty, says which rotation the numbers are."""
    return order in QUATERNIONS or (bool(order) and axes is not None)


def quaternions(numbers: Float[np.ndarray, "n k"], order: str, axes: str | None) -> Float[np.ndarray, "n 4"]:
    """Quaternions (wxyz) of other quaternions, which are taken as they are, or of Euler angles [rad].

    Args:
        numbers: One orientation a row. Shape (n, 4), or (n, 3) for angles.
        order: See `mapping.Values`.
        axes: `intrinsic` or `extrinsic` for angles.
    """
    if order == "wxyz":
        return numbers
    if order == "xyzw":
        return numbers[:, [3, 0, 1, 2]]
    out = np.full((len(numbers), 4), np.nan)
    known = np.isfinite(numbers).all(axis=1)
    if known.any():
        sequence = order if axes == "intrinsic" else order.lower()  # scipy tells the two apart by case.
        out[known] = Rotation.from_euler(sequence, numbers[known]).as_quat(scalar_first=True)
    return out
