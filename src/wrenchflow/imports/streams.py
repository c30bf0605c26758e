"""From the numbers of a take to a stream in our units, signs and orders."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow import signals
from wrenchflow.episode import Stream
from wrenchflow.errors import ConfigError, RecordingError
from wrenchflow.imports.mapping import Clock, StreamMapping
from wrenchflow.imports.parts import PARTS, PARTS_OF_KIND, SIGNED, part_columns, signal_of
from wrenchflow.imports.rotations import is_stated, quaternions
from wrenchflow.imports.stamps import order_of
from wrenchflow.imports.take import Take
from wrenchflow.imports.units import factor_of
from wrenchflow.signals import Signal

# Beyond what any arm does: imported as it is said, and noted.
_MOST = {"force": ("N", 1e5), "position": ("m", 100.0)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Imported:
    """A stream, and what there is to say of how it came about.

    Attributes:
        name: Of the stream here.
        stream: The stream.
        notes: Sentences.
        dropped: How many rows were not later than all before them.
    """

    name: str
    stream: Stream
    notes: tuple[str, ...] = ()
    dropped: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Raw:
    """What a take says, in our order of columns."""

    t: Int64[np.ndarray, " n"]
    data: Float[np.ndarray, "n d"]
    signal: Signal
    frame: str


def import_stream(take: Take, name: str, mapping: StreamMapping, clock: Clock, where: str) -> Imported:
    """Read one stream of a take.

    Args:
        take: Which.
        name: Of the stream.
        mapping: What its numbers mean.
        clock: When they were measured.
        where: Name of the stream's place in the mapping, for messages.

    Raises:
        RecordingError: If the take does not hold what the mapping says, or rows are out of order and may not be.
        ConfigError: If the mapping leaves out what the message type of a topic shows to be needed.
    """
    notes: list[str] = []
    if mapping.topic:
        raw = _of_topic(take, mapping, clock, where, notes)
    else:
        name, mapping = _without_unstated_orientation(name, mapping, notes)
        raw = _of_parts(take, mapping, clock, where)
    data, kind = raw.data, raw.signal.kind
    if kind in SIGNED:
        if mapping.sign is None:
            raise ConfigError(
                f"{where}: the sign is not stated, expected 'robot-on-environment', 'environment-on-robot', or "
                "'unknown'."
            )
        data = -data if mapping.sign == "environment-on-robot" else data
        if mapping.sign == "unknown":
            notes.append(f"Who exerts '{name}' on whom is not known: its sign is taken as it is.")
    order = order_of(raw.t)
    if order.first:
        if clock.disordered == "refuse":
            raise RecordingError(
                f"{where}: {order.told(name)}; expected later and later stamps. Rows like these are left out with "
                "disordered = 'drop' in the clock."
            )
        notes.append(f"{order.told(name)}: these rows were left out.")
    stream = Stream(raw.t[order.keep], np.ascontiguousarray(data[order.keep]), raw.signal, raw.frame)
    notes += _impossible(name, stream)
    return Imported(name=name, stream=stream, notes=tuple(notes), dropped=order.repeated + order.backward)


def _of_topic(take: Take, mapping: StreamMapping, clock: Clock, where: str, notes: list[str]) -> _Raw:
    rows = take.topic(mapping.topic, where)
    kind, data = rows.signal.kind, rows.data.copy()
    for part, values in mapping.parts.items():
        if part not in PARTS_OF_KIND.get(kind, ()):
            raise ConfigError(f"{where}: topic '{mapping.topic}' is a '{kind}', which has no {part}.")
        data[:, part_columns(kind, part, data.shape[1])] *= factor_of(values.unit, PARTS[part].unit, f"{where}.{part}")
    t = rows.header_ns if clock.topic_time == "header" else rows.log_ns
    if t is None:
        raise RecordingError(
            f"{where}: the messages of topic '{mapping.topic}' have no stamp in a header. When the file says that they "
            "were sent is taken with topic_time = 'log' in the clock."
        )
    if mapping.frame and mapping.frame != rows.frame:
        notes.append(
            f"Topic '{mapping.topic}' says that its frame is '{rows.frame}'; the mapping says '{mapping.frame}'."
        )
    return _Raw(t=t, data=data, signal=rows.signal, frame=mapping.frame or rows.frame)


def _without_unstated_orientation(name: str, mapping: StreamMapping, notes: list[str]) -> tuple[str, StreamMapping]:
    """A pose whose orientation could be any of several rotations is a position, and called so."""
    part = mapping.orientation
    if part is None or is_stated(part.order, part.axes):
        return name, mapping
    what = ", ".join(part.columns) or part.variable
    new = f"{name.removesuffix('_pose')}_position"
    missing = (
        "about which axes its angles are (intrinsic or extrinsic)" if part.order else "in which order its numbers are"
    )
    notes.append(
        f"The orientation of '{name}' ({what}) was not imported, for nobody says {missing}; its position is '{new}'."
    )
    return new, replace(mapping, orientation=None)


def _of_parts(take: Take, mapping: StreamMapping, clock: Clock, where: str) -> _Raw:
    kind, blocks, columns, units = mapping.kind, [], [], []
    for name in PARTS_OF_KIND[kind]:
        part, of = mapping.parts[name], f"{where}.{name}"
        width = len(part.order) if name == "orientation" else PARTS[name].width
        numbers = take.numbers(part, width, of)
        if width is not None and numbers.shape[1] != width:
            raise RecordingError(f"{of}: expected {width} channels, got {numbers.shape[1]}.")
        if name == "orientation":
            angles = numbers * factor_of(part.unit, "rad", of) if width == 3 else numbers
            numbers = quaternions(angles, part.order, part.axes)
        elif name == "values":
            columns = list(part.columns) or [f"{part.variable}{i + 1}" for i in range(numbers.shape[1])]
            units = list(part.units)
            if len(units) != len(columns):
                raise ConfigError(f"{of}: expected a unit for each of {len(columns)} channels, got {len(units)}.")
        else:
            numbers = numbers * factor_of(part.unit, PARTS[name].unit, of)
        blocks.append(numbers)
    lengths = [len(block) for block in blocks]
    if len(set(lengths)) > 1 or (kind == "joints" and len({block.shape[1] for block in blocks}) > 1):
        shapes = ", ".join(f"{n} x {block.shape[1]}" for n, block in zip(lengths, blocks, strict=True))
        raise RecordingError(f"{where}: its parts do not fit together: got {shapes}.")
    data = np.concatenate(blocks, axis=1)
    signal = signals.plain(tuple(columns), tuple(units)) if kind == "plain" else signal_of(kind, data.shape[1])
    return _Raw(t=_times(take, clock, len(data), where), data=data, signal=signal, frame=mapping.frame)


def _times(take: Take, clock: Clock, count: int, where: str) -> Int64[np.ndarray, " n"]:
    if clock.rate_hz is not None:
        return np.round(np.arange(count) * (1e9 / clock.rate_hz)).astype(np.int64)
    t = take.stamps(clock, where)
    if len(t) != count:
        raise RecordingError(f"{where}: there are {len(t)} stamps for {count} samples.")
    return t


def _impossible(name: str, stream: Stream) -> list[str]:
    notes = []
    for part, (unit, most) in _MOST.items():
        if part in PARTS_OF_KIND.get(stream.signal.kind, ()):
            largest = float(np.nanmax(np.abs(stream.data[:, :3]), initial=0.0))
            if largest > most:
                notes.append(f"'{name}' reaches {largest:.3g} {unit}, which cannot be right: is its unit?")
    return notes
