"""Stream, Event and Episode: the immutable values that flow from stage to stage."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import StreamError
from wrenchflow.messages import Attachment, Messages
from wrenchflow.signals import Signal


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples of one signal on a clock of their own; nothing is resampled before `datasets`.

    Attributes:
        t: Time stamps [ns], strictly increasing. Shape (n,).
        data: One row a sample, one column a `signal` column, in its units. Shape (n, d).
        signal: What the columns measure.
        frame: The frame that the values are expressed in, such as `base` or `sensor`.
    """

    t: Int64[np.ndarray, " n"]
    data: Float[np.ndarray, "n d"]
    signal: Signal
    frame: str = ""

    def __post_init__(self) -> None:
        if self.t.dtype != np.int64 or self.data.dtype != np.float64:
            raise StreamError(
                f"a stream takes int64 stamps and float64 data, got {self.t.dtype} and {self.data.dtype}."
            )
        if self.t.ndim != 1 or self.data.shape != (len(self.t), self.signal.width):
            raise StreamError(
                f"a '{self.signal.kind}' stream of {self.t.shape} stamps takes data of shape "
                f"({len(self.t)}, {self.signal.width}), got {self.data.shape}."
            )
        if len(self.t) > 1 and not (self.t[1:] > self.t[:-1]).all():
            row = int(np.argmax(self.t[1:] <= self.t[:-1])) + 1
            raise StreamError(
                f"stamps must strictly increase, but stamp {row} is {self.t[row]} after {self.t[row - 1]}."
            )
        object.__setattr__(self, "t", _read_only(self.t))
        object.__setattr__(self, "data", _read_only(self.data))

    def __len__(self) -> int:
        return len(self.t)

    def __eq__(self, other: object) -> bool:
        """Equal when every stamp and every bit of the data is; NaN equals the same NaN."""
        return (
            isinstance(other, Stream)
            and (self.signal, self.frame) == (other.signal, other.frame)
            and np.array_equal(self.t, other.t)
            and self.data.shape == other.data.shape
            and np.ascontiguousarray(self.data).tobytes() == np.ascontiguousarray(other.data).tobytes()
        )

    @property
    def rate_hz(self) -> float:
        """Mean sample rate [Hz]; NaN for fewer than two samples."""
        return float((len(self) - 1) / (self.t[-1] - self.t[0]) * 1e9) if len(self) > 1 else float("nan")

    def column(self, name: str) -> Float[np.ndarray, " n"]:
        """One column by its name. Shape (n,)."""
        if name not in self.signal.columns:
            raise StreamError(
                f"no column '{name}' in a '{self.signal.kind}'. It has: {', '.join(self.signal.columns)}."
            )
        return self.data[:, self.signal.columns.index(name)]

    def between(self, start_ns: int, stop_ns: int) -> "Stream":
        """The samples with start_ns <= t < stop_ns, as a view."""
        first, last = np.searchsorted(self.t, [start_ns, stop_ns])
        return replace(self, t=self.t[first:last], data=self.data[first:last])


@dataclass(frozen=True, order=True)
class Event:
    """Something that happened from `start_ns` to `stop_ns`: contact, anomaly, phase, success, intervention."""

    start_ns: int
    stop_ns: int
    kind: str
    label: str = ""

    def __post_init__(self) -> None:
        if self.stop_ns < self.start_ns:
            raise StreamError(f"event '{self.kind}' stops at {self.stop_ns}, before it starts at {self.start_ns}.")

    def moved(self, offset_ns: int) -> "Event":
        """The same on a clock that shows `offset_ns` more."""
        return replace(self, start_ns=self.start_ns + offset_ns, stop_ns=self.stop_ns + offset_ns)


@dataclass(frozen=True)
class Episode:
    """One attempt at a task: streams at their own rates, events, what is known about it, and what came along.

    Attributes:
        id: Name of the episode and of its file.
        task: The task that was attempted.
        streams: Streams by name; a name is the MCAP topic without its leading slash.
        events: In order of their start.
        meta: JSON values, such as `rig`, `seed`, `success`.
        messages: Topics that are no streams, by name: images, and what is not known here, which is kept all the same.
        attachments: Files by name.
    """

    id: str
    task: str
    streams: Mapping[str, Stream] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    meta: Mapping[str, Any] = field(default_factory=dict)
    messages: Mapping[str, Messages] = field(default_factory=dict)
    attachments: Mapping[str, Attachment] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("streams", "meta", "messages", "attachments"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "events", tuple(sorted(self.events)))

    def __getitem__(self, name: str) -> Stream:
        if name not in self.streams:
            raise StreamError(
                f"stream '{name}' is not in episode {self.id}. It has: {', '.join(sorted(self.streams))}."
            )
        return self.streams[name]

    def __contains__(self, name: str) -> bool:
        return name in self.streams

    def __reduce__(self):  # A MappingProxyType does not pickle, and episodes travel between processes.
        known = (self.id, self.task, dict(self.streams), self.events, dict(self.meta))
        return Episode, (*known, dict(self.messages), dict(self.attachments))

    def with_stream(self, name: str, stream: Stream) -> "Episode":
        """A new episode with `stream` added, or put in the place of the one of that name."""
        return replace(self, streams={**self.streams, name: stream})

    def with_events(self, *events: Event) -> "Episode":
        """A new episode with `events` added."""
        return replace(self, events=self.events + events)

    def with_meta(self, **meta: Any) -> "Episode":
        """A new episode with `meta` entries added or replaced."""
        return replace(self, meta={**self.meta, **meta})

    def events_of(self, kind: str) -> tuple[Event, ...]:
        """The events of one kind, in order."""
        return tuple(event for event in self.events if event.kind == kind)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp over all streams [ns]; (0, 0) without samples."""
        stamps = [s.t[[0, -1]] for s in self.streams.values() if len(s)]
        return (int(min(s[0] for s in stamps)), int(max(s[1] for s in stamps))) if stamps else (0, 0)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp [s]."""
        start_ns, stop_ns = self.span_ns
        return (stop_ns - start_ns) * 1e-9
