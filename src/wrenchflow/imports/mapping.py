"""The mapping: what the numbers of a foreign recording mean, as a person states it in a TOML file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from wrenchflow.config import load
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.imports.parts import FRAMELESS, KIND_OF_PARTS, PARTS, PARTS_OF_KIND, SIGNED
from wrenchflow.imports.rotations import EULER, QUATERNIONS, is_stated
from wrenchflow.imports.units import factor_of

TIME_UNITS_NS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


@dataclass(frozen=True, kw_only=True)
class Clock:
    """When a row was measured.

    Attributes:
        stamps: Column or variable of the stamps.
        unit: Theirs.
        rate_hz: Assumed of a file without stamps: row k is at k / rate_hz.
        topic_time: Of a topic: the stamp in the messages' header, or when the file says that they were sent.
        disordered: What to do with a row that is not later than all before it: refuse the file, or drop the row.
    """

    stamps: str = ""
    unit: Literal["s", "ms", "us", "ns"] | None = None
    rate_hz: float | None = None
    topic_time: Literal["header", "log"] = "header"
    disordered: Literal["refuse", "drop"] = "refuse"


@dataclass(frozen=True, kw_only=True)
class Values:
    """Where some numbers are.

    Attributes:
        columns: Of a table, by name.
        variable: Of a MATLAB file: an array of channels by samples, or the other way round.
        pick: Which of its channels, from 1 on; all of them if empty.
        samples: Where its shape does not tell: whether a sample is one of its rows or one of its columns.
        unit: Of all of them.
        units: Of `values`: one each, free text.
        order: Of an orientation: `wxyz` or `xyzw`, or the axes of three Euler angles, such as `ZYX`.
        axes: Of Euler angles: about the axes that turn along, or about those that stay.
    """

    columns: tuple[str, ...] = ()
    variable: str = ""
    pick: tuple[int, ...] = ()
    samples: Literal["rows", "columns"] | None = None
    unit: str = ""
    units: tuple[str, ...] = ()
    order: str = ""
    axes: Literal["intrinsic", "extrinsic"] | None = None


@dataclass(frozen=True, kw_only=True)
class StreamMapping:
    """One stream: a topic, or the parts that it is put together of.

    Attributes:
        topic: Name of a topic; its message type says what it measures, and a part here only its unit.
        frame: That the values are in; `sensor` is what a raw wrench has to be in.
        sign: Who exerts the wrench on whom.
        clock: Where it differs from that of the other streams.
    """

    topic: str = ""
    frame: str = ""
    sign: Literal["robot-on-environment", "environment-on-robot", "unknown"] | None = None
    clock: Clock | None = None
    force: Values | None = None
    moment: Values | None = None
    position: Values | None = None
    orientation: Values | None = None
    linear: Values | None = None
    angular: Values | None = None
    joint_position: Values | None = None
    joint_velocity: Values | None = None
    joint_torque: Values | None = None
    values: Values | None = None

    @property
    def parts(self) -> dict[str, Values]:
        """The parts that are stated, by name."""
        return {name: part for name in PARTS if (part := getattr(self, name)) is not None}

    @property
    def kind(self) -> str:
        """The kind of signal that the parts make."""
        return KIND_OF_PARTS[frozenset(self.parts)]


@dataclass(frozen=True, kw_only=True)
class FileLayout:
    """How a file is laid out.

    Attributes:
        delimiter: Between the cells of a table.
        header: Whether the first row of a table has the names; else columns are called 1, 2, 3 ...
        takes: Of a MATLAB file: a struct array, each element of which is an episode and has the variables as fields.
    """

    delimiter: str = ","
    header: bool = True
    takes: str = ""


@dataclass(frozen=True, kw_only=True)
class ImportMapping:
    """What a foreign recording holds.

    Attributes:
        task: What was done.
        rig: Name of a rig, or path of its file from the mapping's folder on; empty if nothing is known.
        assumptions: What whoever wrote the mapping had to assume, in sentences; the report shows them.
        file: How it is laid out.
        clock: Of all streams that have none of their own.
        streams: By their names here.
    """

    task: str
    streams: dict[str, StreamMapping]
    rig: str = ""
    assumptions: tuple[str, ...] = ()
    file: FileLayout = field(default_factory=FileLayout)
    clock: Clock | None = None

    def clock_of(self, stream: StreamMapping) -> Clock:
        """The clock of one of the streams."""
        return stream.clock or self.clock or Clock()


def load_mapping(path: Path) -> ImportMapping:
    """Read a mapping.

    Raises:
        ConfigError: If it cannot be read, has an unknown key, or leaves out what nobody may guess.
    """
    mapping = load(ImportMapping, path)
    if not mapping.streams:
        raise ConfigError(f"{path.name}: no stream is stated, expected [streams.NAME] at least once.")
    if len(mapping.file.delimiter) != 1:
        raise ConfigError(f"{path.name}.file.delimiter is {mapping.file.delimiter!r}, expected one character.")
    for name, stream in mapping.streams.items():
        where = f"{path.name}.streams.{name}"
        _check_name(name, where)
        _check_clock(mapping.clock_of(stream), stream, where)
        if stream.topic:
            _check_topic(stream, where)
        else:
            _check_parts(stream, where)
    return mapping


def _check_name(name: str, where: str) -> None:
    if not name or name != name.strip("/") or any(not (c.isalnum() or c in "_/-") for c in name):
        raise ConfigError(f"{where}: a stream's name takes letters, digits, '_', '-' and inner '/', got '{name}'.")


def _check_clock(clock: Clock, stream: StreamMapping, where: str) -> None:
    stated = [name for name, given in (("stamps", clock.stamps), ("rate_hz", clock.rate_hz is not None)) if given]
    if stream.topic:
        if stated:
            raise ConfigError(f"{where}: a topic has stamps of its own, got {stated[0]} in its clock.")
        return
    if len(stated) != 1:
        got = "both" if stated else "neither"
        raise ConfigError(f"{where}: a clock takes either stamps or rate_hz, got {got}.")
    if clock.stamps and clock.unit is None:
        raise ConfigError(f"{where}: the unit of its clock is not stated. Available: {', '.join(TIME_UNITS_NS)}.")
    if clock.rate_hz is not None and not 1e-3 <= clock.rate_hz <= 1e6:
        raise ConfigError(f"{where}: rate_hz of its clock is {clock.rate_hz:g}, expected from 0.001 to 1e+06.")


def _check_topic(stream: StreamMapping, where: str) -> None:
    for name, part in stream.parts.items():
        if part != Values(unit=part.unit):
            raise ConfigError(f"{where}.{name}: of a topic only the unit can be stated.")
        if name not in ("orientation", "values"):
            factor_of(part.unit, PARTS[name].unit, f"{where}.{name}")


def _check_parts(stream: StreamMapping, where: str) -> None:
    parts = stream.parts
    if frozenset(parts) not in KIND_OF_PARTS:
        kinds = "; ".join(" + ".join(parts) for parts in PARTS_OF_KIND.values())
        got = " + ".join(parts) or "no part and no topic"
        raise ConfigError(f"{where}: {got} makes no stream. Available: a topic; {kinds}.")
    if stream.kind in SIGNED and stream.sign is None:
        raise ConfigError(
            f"{where}: the sign is not stated, expected 'robot-on-environment', 'environment-on-robot', or 'unknown'."
        )
    if stream.kind not in FRAMELESS and not stream.frame:
        raise ConfigError(f"{where}: the frame is not stated, expected 'sensor', 'base', or any other name.")
    for name, part in parts.items():
        _check_part(name, part, f"{where}.{name}")


def _check_part(name: str, part: Values, where: str) -> None:
    if bool(part.columns) == bool(part.variable):
        raise ConfigError(f"{where}: expected either columns or a variable, got {'both' if part.variable else 'none'}.")
    if any(channel < 1 for channel in part.pick):
        raise ConfigError(f"{where}: pick counts from 1 on, got {min(part.pick)}.")
    width, count = PARTS[name].width, len(part.columns) or len(part.pick)
    if width is not None and count not in (0, width):
        raise ConfigError(f"{where}: expected {width} columns, got {count}.")
    if name == "values":
        if part.columns and len(part.units) != len(part.columns):
            raise ConfigError(
                f"{where}: expected a unit for each of {len(part.columns)} columns, got {len(part.units)}."
            )
    elif part.units:
        raise ConfigError(f"{where}: its columns share one unit, got a list of {len(part.units)}.")
    elif name != "orientation":
        factor_of(part.unit, PARTS[name].unit, where)
    if name == "orientation":
        _check_orientation(part, where)
    elif part.order or part.axes:
        raise ConfigError(f"{where}: order and axes are of an orientation.")


def _check_orientation(part: Values, where: str) -> None:
    if part.order and part.order not in QUATERNIONS + EULER:
        raise ConfigError(f"{where}: {unknown('order of an orientation', part.order, QUATERNIONS + EULER)}")
    if not is_stated(part.order, part.axes):
        return  # It is not imported, which is noted; what its columns are in does not matter.
    expected = len(part.order)
    count = len(part.columns) or len(part.pick) or expected
    if count != expected:
        raise ConfigError(f"{where}: the order {part.order} takes {expected} columns, got {count}.")
    if expected == 3:
        factor_of(part.unit, "rad", where)
    elif part.unit not in ("", "1"):
        raise ConfigError(f"{where}: a quaternion has no unit, got '{part.unit}'.")
