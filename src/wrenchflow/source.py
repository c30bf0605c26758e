"""What is recorded while it happens: sources with rows of their own, and the streams that their columns are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from wrenchflow.errors import StreamError
from wrenchflow.signals import Signal

T, RECEIVED, SEQUENCE, OFFSET = "t_ns", "received_ns", "sequence", "clock_offset_ns"


@dataclass(frozen=True, kw_only=True)
class Column:
    """One stream in the rows of a source.

    Attributes:
        name: Of the stream, and of the field of the row.
        signal: What it measures.
        frame: The frame that its values are expressed in.
        lag_ns: How long before the row's stamp it was sampled [ns]; what was sampled before the first row's stamp is
            left out.
    """

    name: str
    signal: Signal
    frame: str = ""
    lag_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class Source:
    """Something with a clock and a rate of its own: the control loop, a sensor, a device.

    Attributes:
        name: Of the source.
        dtype: Of a row: `t_ns`, when it was sampled; a field for each column; and where there are some, `received_ns`,
            when we had it, `sequence`, its number at the source, and `clock_offset_ns`, how far our clock is ahead of
            the source's own (see `clock.ClockOffset`). Stamps are int64 nanoseconds of one clock.
        columns: The streams.
        capacity: Rows that wait at most for the writer.
    """

    name: str
    dtype: np.dtype
    columns: tuple[Column, ...]
    capacity: int = 4096

    def __post_init__(self) -> None:
        fields = {name: self.dtype[name] for name in self.dtype.names or ()}
        for name in (T, *(column.name for column in self.columns)):
            if name not in fields:
                raise StreamError(f"source '{self.name}' has no field '{name}'. It has: {', '.join(fields) or 'none'}.")
        for column in self.columns:
            width = int(np.prod(fields[column.name].shape, dtype=int))
            if width != column.signal.width:
                raise StreamError(
                    f"field '{column.name}' of source '{self.name}' has {width} values, and a "
                    f"'{column.signal.kind}' has {column.signal.width}."
                )


@dataclass(frozen=True)
class Samples:
    """What rows say of one stream: stamps [ns], values, and receive times and numbers where there are any."""

    t: Int64[np.ndarray, " n"]
    data: np.ndarray
    received: np.ndarray | None
    sequence: np.ndarray | None


def samples_of(rows: np.ndarray, column: Column, start_ns: int) -> Samples:
    """One stream's samples in some rows.

    Args:
        rows: Of the source, in their order.
        column: Which stream.
        start_ns: Stamp of the source's first row ever [ns].
    """
    kept = rows[rows[T] - column.lag_ns >= start_ns] if column.lag_ns else rows
    names = kept.dtype.names or ()
    return Samples(
        kept[T] - column.lag_ns,
        np.ascontiguousarray(kept[column.name], float).reshape(len(kept), column.signal.width),
        kept[RECEIVED].copy() if RECEIVED in names else None,
        kept[SEQUENCE].copy() if SEQUENCE in names else None,
    )
