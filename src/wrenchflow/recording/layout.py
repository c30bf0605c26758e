"""All messages of a topic at once: one template of constant bytes, and a numpy dtype for what varies.

Names and frame ids are constant within a topic, so all its message records have one size. Where the numbers lie comes
from reading one message with `codec.decode`; encoding and decoding then move whole columns.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int64, UInt8, UInt64
from mcap.opcode import Opcode

from wrenchflow.clock import SECOND_NS
from wrenchflow.errors import StreamError
from wrenchflow.recording import codec, schemas
from wrenchflow.signals import Signal

# A message record in a chunk starts with these, without padding; its CDR follows.
HEADER = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_OFFSETS = {name: offset for name, (_, offset, *_) in (HEADER.fields or {}).items()}
# The length of a record counts what follows its opcode and the length itself.
UNCOUNTED = 9


def record_header(channel: int, length: int, sequence: int, t: int, received: int | None = None) -> bytes:
    """What precedes a message of `length` bytes that was published at `t` and logged at `received`, or at `t` [ns]."""
    counted = HEADER.itemsize - UNCOUNTED + length
    return np.array(
        (Opcode.MESSAGE, counted, channel, sequence, t if received is None else received, t), HEADER
    ).tobytes()


class Parts(NamedTuple):
    """A layout as `records.take_samples` takes it, and whether every column is held by a run."""

    constant: UInt64[np.ndarray, "k 3"]
    runs: UInt64[np.ndarray, "m 6"]
    stamp: UInt64[np.ndarray, " s"]
    are_all_held: bool


@dataclass(frozen=True, eq=False)
class Layout:
    """Where everything lies in a message record of one topic.

    Attributes:
        signal: What the columns measure.
        template: A whole record. Shape (size,).
        varying: Structured dtype of `size` bytes whose fields are all that may differ between records.
        runs: Field of `varying` and columns of the data that it holds.
        constant: The byte ranges between the fields of `varying`.
    """

    signal: Signal
    template: UInt8[np.ndarray, " size"]
    varying: np.dtype
    runs: tuple[tuple[str, slice], ...]
    constant: tuple[slice, ...]

    @classmethod
    @lru_cache(maxsize=256)  # Every episode of a folder has the same topics.
    def for_stream(cls, signal: Signal, frame: str, channel: int) -> "Layout":
        """The layout that a new topic is written with."""
        cdr = codec.encode(schemas.message_of(signal), schemas.blank_message(signal, frame))
        return cls.of_record(signal, record_header(channel, len(cdr), sequence=0, t=0) + cdr)

    @classmethod
    def of_record(cls, signal: Signal, record: bytes) -> "Layout":
        """The layout of the records that look like this one. A column that it does not hold stays NaN."""
        start = HEADER.itemsize
        leaves = codec.decode(schemas.message_of(signal), record[start:])
        fields = [(name, _OFFSETS[name], HEADER[name].str) for name in ("sequence", "log_time", "publish_time")]
        for name in ("sec", "nanosec"):
            if leaf := leaves.get(f"header.stamp.{name}"):
                fields.append((name, start + leaf.offset, leaf.code))

        # Neighbouring columns that are neighbours in the message too are moved as one block.
        places = [(i, leaves[path]) for i, path in enumerate(schemas.column_paths(signal)) if path in leaves]
        runs: list[list[tuple[int, codec.Leaf]]] = []
        for column, leaf in places:
            last_column, last = runs[-1][-1] if runs else (-2, leaf)
            is_next = last_column + 1 == column and last.offset + np.dtype(last.code).itemsize == leaf.offset
            if is_next and last.code == leaf.code:
                runs[-1].append((column, leaf))
            else:
                runs.append([(column, leaf)])
        names = [(f"run{i}", slice(run[0][0], run[-1][0] + 1)) for i, run in enumerate(runs)]
        for (name, _), run in zip(names, runs, strict=True):
            fields.append((name, start + run[0][1].offset, f"({len(run)},){run[0][1].code}"))

        varying = np.dtype(
            {
                "names": [name for name, _, _ in fields],
                "offsets": [offset for _, offset, _ in fields],
                "formats": [code for _, _, code in fields],
                "itemsize": len(record),
            }
        )
        spans = sorted((offset, offset + varying[name].itemsize) for name, offset, _ in fields)
        edges = [(0, 0), *spans, (len(record), len(record))]
        constant = tuple(slice(a[1], b[0]) for a, b in pairwise(edges) if b[0] > a[1])
        return cls(signal, np.frombuffer(record, np.uint8), varying, tuple(names), constant)

    @property
    def size(self) -> int:
        """Bytes of one record."""
        return len(self.template)

    @property
    def _has_stamp(self) -> bool:
        return "sec" in (self.varying.names or ())

    def check(self, data: Float[np.ndarray, "n d"]) -> None:
        """Refuse values that would not survive, bit for bit, in the types that the message has for them.

        Raises:
            StreamError: If there are any; it names the first.
        """
        for name, columns in self.runs:
            code = self.varying[name].base
            if code == data.dtype:
                continue
            values = np.ascontiguousarray(data[:, columns])
            with np.errstate(invalid="ignore", over="ignore"):
                kept = values.astype(code).astype(data.dtype)
            changed = np.argwhere(values.view(np.int64) != kept.view(np.int64))
            if len(changed):
                row, column = changed[0]
                raise StreamError(
                    f"column '{self.signal.columns[columns][column]}' of a '{self.signal.kind}' is recorded as "
                    f"{code.name}, which cannot hold {values[row, column]} (row {row})."
                )

    def encode(
        self,
        t: Int64[np.ndarray, " n"],
        data: Float[np.ndarray, "n d"],
        *,
        sequence: Int64[np.ndarray, " n"],
        received: Int64[np.ndarray, " n"],
        out: UInt8[np.ndarray, "n size"],
    ) -> None:
        """Write the records of consecutive samples.

        Args:
            t: Time stamps [ns]. Shape (n,).
            data: Rows of the signal, which `check` has passed. Shape (n, d).
            sequence: Number of each sample at its source. Shape (n,).
            received: When each was had [ns]. Shape (n,).
            out: Where the records go.
        """
        out[:] = self.template
        fields = out.view(self.varying)[:, 0]
        fields["sequence"] = sequence
        fields["log_time"], fields["publish_time"] = received, t
        if self._has_stamp:
            seconds = t // SECOND_NS
            fields["sec"] = seconds
            fields["nanosec"] = t - seconds * SECOND_NS
        for name, columns in self.runs:
            fields[name] = data[:, columns]

    @cached_property
    def parts(self) -> Parts:
        """The same for the compiled loop that decodes."""
        fields: Any = self.varying.fields
        runs = []
        for name, columns in self.runs:
            code, place = fields[name][0].base, fields[name][1]
            kind = _KINDS.index(code.newbyteorder("<").str)
            runs.append((place, columns.start, columns.stop - columns.start, kind, code.itemsize, _is_big(code)))
        sec = fields.get("sec")
        constant = np.zeros(self.size, np.uint8)
        for part in self.constant:
            constant[part] = 255
        return Parts(
            constant=_words(self.template, constant),
            runs=np.array(runs, np.uint64).reshape(-1, 6),
            stamp=np.array((sec[1], _is_big(sec[0])) if sec else (), np.uint64),
            are_all_held=sum(columns.stop - columns.start for _, columns in self.runs) == self.signal.width,
        )


# In the order of the numbers that `records` gives them.
_KINDS = ("<f8", "<f4", "<i4", "<u4", "|u1")


def _words(template: UInt8[np.ndarray, " size"], mask: UInt8[np.ndarray, " size"]) -> UInt64[np.ndarray, "k 3"]:
    """Where each word of eight bytes starts that holds masked bytes, the word, and its mask."""
    words, left = [], mask.copy()
    while left.any():
        # A record is longer than its header, so the last word fits too.
        start = min(int(np.argmax(left)), len(left) - 8)
        part = slice(start, start + 8)
        words.append((start, *(of[part].view("<u8")[0] for of in (template.copy(), left))))
        left[part] = 0
    return np.array(words, np.uint64).reshape(-1, 3)


def _is_big(code: np.dtype) -> bool:
    return code.str[0] == ">"
