"""What there is to see in an episode, or in one that is being recorded: streams, cameras, kinds of events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Episode
from wrenchflow.ledger import ENERGIES, WORK
from wrenchflow.recording.schemas import IMAGE_MESSAGE
from wrenchflow.signals import Signal
from wrenchflow.source import Source
from wrenchflow.spatial import compose, inverse

TIMELINE = "time"
WORLD, EVENTS = "/world", "/events"
PATH = f"{WORLD}/path"
# The arrow of `wrench` is in the base's axes; what the sensor reads is in its own, and hangs on the tcp.
FORCE, FORCE_AS_READ = f"{WORLD}/force", f"{WORLD}/tcp_pose/force_as_read"

# What the columns of a unit are called together. A dimensionless column is told apart by the kind of its signal.
_QUANTITIES = {
    "N": "force",
    "N.m": "torque",
    "m": "position",
    "rad": "angle",
    "m/s": "velocity",
    "rad/s": "angular_velocity",
    "N/m": "stiffness",
    "N.m/rad": "rotational_stiffness",
}
# Streams that are drawn beside another one, and what a legend calls them.
_BESIDE = {
    "wrench_zero_phase": "zero-phase",
    "target_pose": "target",
    "command_pose": "command",
    "request": "asked",
}
_DIMENSIONLESS = {"pose": "orientation", "impedance": "damping_ratio", "request": "damping_ratio", "mask": "flags"}
# Columns that are no plot together with all of their unit, by kind of signal.
_APART = {
    "governor": {
        **dict.fromkeys(ENERGIES, "energy"),
        **dict.fromkeys(WORK, "work"),
        **{name: name for name in ("mode", "cause", "acting")},
    },
    "request": {"gripper": "gripper"},
}


@dataclass(frozen=True, kw_only=True)
class Series:
    """The columns of a stream that are drawn in one plot.

    Attributes:
        entity: Where Rerun keeps them: `/<stream>/<quantity>`.
        stream: Name of the stream.
        quantity: What they are, such as `force`.
        columns: Which columns of the stream.
        names: Name of each, for a legend.
        units: Unit of each.
        is_beside: Whether they are drawn beside those of another stream, for comparison.
    """

    entity: str
    stream: str
    quantity: str
    columns: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    is_beside: bool


def series_of(stream: str, signal: Signal) -> tuple[Series, ...]:
    """The plots of a stream: columns that measure the same quantity are drawn together."""
    groups: dict[str, list[int]] = {}
    apart = _APART.get(signal.kind, {})
    for column, (name, unit) in enumerate(zip(signal.columns, signal.units, strict=True)):
        quantity = apart.get(name) or _QUANTITIES.get(unit) or _DIMENSIONLESS.get(signal.kind, "values")
        groups.setdefault(quantity, []).append(column)
    return tuple(
        Series(
            entity=f"/{stream}/{quantity}",
            stream=stream,
            quantity=quantity,
            columns=tuple(columns),
            names=tuple(f"{signal.columns[column]} {_BESIDE.get(stream, '')}".strip() for column in columns),
            is_beside=stream in _BESIDE,
            units=tuple(signal.units[column] for column in columns),
        )
        for quantity, columns in groups.items()
    )


@dataclass(frozen=True, kw_only=True)
class Contents:
    """What there is to see.

    Attributes:
        id: Name of the episode.
        streams: Signal and frame of each stream.
        cameras: Names of the topics with images.
        lanes: Kinds of the events that last.
        instants: What happened at one moment, such as `success`.
        T_tcp_sensor: Pose of the force sensor in the tcp, where the rig is known. Shape (7,).
        box_m: Corners of the box that the body's path lies in [m], where it is known. Shape (2, 3).
    """

    id: str
    streams: Mapping[str, tuple[Signal, str]]
    cameras: tuple[str, ...] = ()
    lanes: tuple[str, ...] = ()
    instants: tuple[str, ...] = ()
    T_tcp_sensor: Float[np.ndarray, " 7"] | None = None
    box_m: Float[np.ndarray, "2 3"] | None = None

    @classmethod
    def of_episode(cls, episode: Episode) -> "Contents":
        """Of a whole episode."""
        lasting = [event for event in episode.events if event.stop_ns > event.start_ns]
        instants = [event for event in episode.events if event.stop_ns == event.start_ns]
        contents = cls(
            id=episode.id,
            streams={name: (stream.signal, stream.frame) for name, stream in episode.streams.items()},
            cameras=tuple(name for name, messages in episode.messages.items() if messages.type.name == IMAGE_MESSAGE),
            lanes=tuple(dict.fromkeys(event.kind for event in lasting)),
            instants=tuple(dict.fromkeys(f"{event.kind} {event.label}".strip() for event in instants)),
            T_tcp_sensor=_sensor_in_tcp(episode.meta),
        )
        path_m = episode[contents.body].data[:, :3] if contents.body else np.empty((0, 3))
        path_m = path_m[np.isfinite(path_m).all(axis=1)]
        return replace(contents, box_m=np.array([path_m.min(axis=0), path_m.max(axis=0)])) if len(path_m) else contents

    @classmethod
    def of_sources(
        cls, id: str, sources: Sequence[Source], cameras: Sequence[str], meta: Mapping[str, Any]
    ) -> "Contents":
        """Of what some sources will give."""
        columns = [column for source in sources for column in source.columns]
        return cls(
            id=id,
            streams={column.name: (column.signal, column.frame) for column in columns},
            cameras=tuple(cameras),
            T_tcp_sensor=_sensor_in_tcp(meta),
        )

    @property
    def poses(self) -> tuple[str, ...]:
        """The poses that are drawn in space: all that are in the frame of the tcp's, or of the first."""
        frames = {name: frame for name, (signal, frame) in self.streams.items() if signal.kind == "pose"}
        world = frames.get("tcp_pose", next(iter(frames.values()), ""))
        return tuple(name for name, frame in frames.items() if frame == world)

    @property
    def body(self) -> str | None:
        """The pose that moves through space, with axes and a path: the tcp's, or else the first there is."""
        return "tcp_pose" if "tcp_pose" in self.poses else next(iter(self.poses), None)

    @property
    def forces(self) -> tuple[str, ...]:
        """The streams of force that are plotted first: what `process` made of the sensor's, or else all there are."""
        kinds = {name: signal.kind for name, (signal, _) in self.streams.items()}
        processed = tuple(name for name in ("wrench", "wrench_zero_phase") if kinds.get(name) == "wrench")
        return processed or tuple(name for name, kind in kinds.items() if kind in ("wrench", "force"))

    @property
    def arrow(self) -> str | None:
        """The stream whose force is drawn as an arrow at the tcp: `wrench`, or else what the sensor reads."""
        if "tcp_pose" not in self.poses:
            return None
        if "wrench" in self.forces and self.streams["wrench"][1] == self.streams["tcp_pose"][1]:
            return "wrench"
        is_read = "wrench_raw" in self.forces and self.streams["wrench_raw"][1] == "sensor"
        return "wrench_raw" if is_read and self.T_tcp_sensor is not None else None

    @property
    def arrow_entity(self) -> str:
        """Where the arrow is."""
        return FORCE_AS_READ if self.arrow == "wrench_raw" else FORCE

    @property
    def series(self) -> tuple[Series, ...]:
        """The plots of all streams."""
        return tuple(series for name, (signal, _) in self.streams.items() for series in series_of(name, signal))


def _sensor_in_tcp(meta: Mapping[str, Any]) -> Float[np.ndarray, " 7"] | None:
    try:
        rig = meta["rig"]
        T_flange_tcp, T_flange_sensor = np.array(rig["T_flange_tcp"]), np.array(rig["sensor"]["T_flange_sensor"])
    except (KeyError, TypeError):
        return None  # A recording of another writer need not know its rig.
    return compose(inverse(T_flange_tcp), T_flange_sensor)
