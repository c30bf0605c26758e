"""A ring of rows in shared memory: one process stores, another one takes, and neither waits for the other.

Order of memory. The producer alone writes `head` and the rows from `head` on; the consumer alone writes `tail`. A row
is the consumer's once `head` is past it, and its place is the producer's again once `tail` is past it. So the
producer's stores to a row must be seen before its store to `head` (a release), and the consumer's loads of a row must
come after its load of `head` (an acquire) and before its store to `tail` (a release). Eight aligned bytes are stored
and loaded in one piece on every machine that we run on; a fence on either side keeps both the compiler and a weakly
ordered processor, such as an ARM, from moving anything across. `head` and `tail` never wrap (a uint64 of milliseconds
lasts 584 million years), so `head - tail` is how many rows wait, and a full ring cannot be mistaken for an empty one.
"""

import os
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from wrenchflow.compiled import kernel
from wrenchflow.errors import OutputError, StreamError

# Each counter has a cache line of its own: the two processes write them all the time.
_LINE = 64
_COUNTERS = np.dtype(
    {
        "names": ["head", "dropped", "tail"],
        "formats": ["u8", "u8", "u8"],
        "offsets": [0, 8, _LINE],
        "itemsize": 2 * _LINE,
    }
)

# Where the counters are, in steps of eight bytes.
_HEAD, _DROPPED, _TAIL = 0, 1, _LINE // 8

_PLACE = Path("/dev/shm")  # Where Linux keeps shared memory, as files.


def _make_fence(context):
    def generate(context, builder, signature, arguments):
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


_fence: Any = intrinsic(_make_fence)


@kernel
def _push(memory, row, size):
    counters = memory[: 2 * _LINE].view(np.uint64)
    head, tail = counters[_HEAD], counters[_TAIL]
    _fence()
    rows = memory[2 * _LINE :]
    capacity = np.uint64(rows.shape[0] // row.shape[0])
    if head - tail >= capacity:
        counters[_DROPPED] += np.uint64(1)
        return False
    start = np.int64(head % capacity) * row.shape[0]
    rows[start : start + size] = row[:size]
    _fence()
    counters[_HEAD] = head + np.uint64(1)
    return True


@kernel
def _waiting(counters):
    tail, head = counters[0].tail, counters[0].head
    _fence()
    return tail, head


@kernel
def _give_back(counters, tail):
    _fence()
    counters[0].tail = tail


def load_push() -> None:
    """Load the code that stores rows, which takes up to a second, before there are any."""
    _push(np.zeros(2 * _LINE + 8, np.uint8), np.zeros(8, np.uint8), 8)


def _reserve(size: int) -> SharedMemory:
    """Shared memory that is there: where the system has promised more than it has, it ends whoever touches that."""
    memory: SharedMemory | None = None
    try:
        memory = SharedMemory(create=True, size=size)
        place = _PLACE / memory.name
        if place.exists():  # Elsewhere than on Linux shared memory is no file, and nothing but a touch can tell.
            with place.open("r+b") as file:
                os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if memory is not None:
            memory.close()
            memory.unlink()
        why = (error.strerror or str(error)).lower()
        raise OutputError(f"no ring of {size} bytes can be made in shared memory: {why}.") from error
    return memory


TAP_ROWS = 512  # Rows that wait at most for who looks at what is recorded.


class Ring:
    """One end of a ring; `create` makes it, `attach` opens it in the other process.

    Attributes:
        name: By which the other process finds it.
        dtype: Of a row.
        capacity: Rows that fit.
    """

    def __init__(self, memory: SharedMemory, dtype: np.dtype, capacity: int) -> None:
        """Lay rows over shared memory; use `create` or `attach`."""
        self._memory = memory
        self.name, self.dtype, self.capacity = memory.name, dtype, capacity
        self._counters = np.ndarray(1, _COUNTERS, memory.buf)
        self._rows = np.ndarray(capacity, dtype, memory.buf, offset=_COUNTERS.itemsize)
        # Rows are stored as bytes: one compiled function serves rows of any kind. It is called with as few arrays as
        # can be, and the bytes of a row that is filled again and again are looked up once: each costs as much as the
        # copy does.
        self._bytes = np.ndarray(_COUNTERS.itemsize + capacity * dtype.itemsize, np.uint8, memory.buf)
        self._row_bytes = np.empty(0, np.uint8)
        self._row: np.ndarray = self._row_bytes

    @classmethod
    def create(cls, dtype: np.dtype, capacity: int) -> "Ring":
        """Make a ring of `capacity` rows, empty.

        Raises:
            OutputError: If there is not enough shared memory left.
            StreamError: If it would hold no row.
        """
        if capacity < 1:
            raise StreamError(f"a ring holds at least 1 row, got {capacity}.")
        memory = _reserve(_COUNTERS.itemsize + capacity * dtype.itemsize)
        ring = cls(memory, dtype, capacity)
        ring._counters[:] = 0
        # Every page is touched now, not by the control loop when it first gets there. So is the code.
        ring._bytes[:] = 0
        ring.push(np.zeros(1, dtype))
        ring._counters[:] = 0
        return ring

    @classmethod
    def attach(cls, name: str, dtype: np.dtype, capacity: int) -> "Ring":
        """Open a ring that another process made."""
        return cls(SharedMemory(name), dtype, capacity)

    def push(self, row: np.ndarray, size: int | None = None) -> bool:
        """Store a row, an array of one record; False, and counted, where the ring is full. Never waits.

        Args:
            row: Shape (1,).
            size: How many bytes of it matter; without it, all.

        Raises:
            StreamError: If it is no such row.
        """
        if row is not self._row:
            if row.dtype != self.dtype or row.shape != (1,):
                raise StreamError(f"a ring takes one row of {self.dtype}, got {row.shape} of {row.dtype}.")
            self._row, self._row_bytes = row, row.view(np.uint8)
        return _push(self._bytes, self._row_bytes, self.dtype.itemsize if size is None else size)

    def refuse(self) -> None:
        """Count a row that was lost before it could be stored."""
        self._counters["dropped"] += 1

    def take(self, most: int | None = None) -> np.ndarray:
        """A copy of the rows that wait, oldest first; their places are free afterwards.

        Args:
            most: How many are taken at once; without it, all.
        """
        tail, head = _waiting(self._counters)
        count = int(head - tail) if most is None else min(int(head - tail), most)
        first = int(tail % self.capacity)
        rows = np.concatenate((self._rows[first : first + count], self._rows[: max(0, first + count - self.capacity)]))
        _give_back(self._counters, tail + np.uint64(count))
        return rows

    @property
    def dropped(self) -> int:
        """Rows that found the ring full, and are lost."""
        return int(self._counters["dropped"][0])

    def close(self) -> None:
        """Let go of the memory; the other process keeps it."""
        del self._counters, self._rows, self._bytes
        self._memory.close()

    def unlink(self) -> None:
        """Let the memory go once both processes have let go of it; whoever made the ring calls this."""
        self._memory.unlink()
