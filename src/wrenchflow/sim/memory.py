"""Memory that the simulator owns, as arrays inside compiled code."""

from typing import Any

import numba
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from wrenchflow.compiled import kernel

_numba: Any = numba  # A module whose names are made at run time.


def _to_pointer(context, address):
    def generate(_, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(address), generate


_pointer: Any = intrinsic(_to_pointer)


@kernel
def floats_at(address, count):
    """The `count` float64 that lie at an address, as an array over that memory; for compiled code only."""
    return _numba.carray(_pointer(address), (count,), np.float64)
