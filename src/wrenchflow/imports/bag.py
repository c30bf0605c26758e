"""The topics of a ROS 2 bag: a folder with metadata.yaml, in sqlite3 or MCAP. The one file that imports rosbags."""

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from wrenchflow import signals
from wrenchflow.errors import RecordingError, unknown
from wrenchflow.imports.take import TopicRows
from wrenchflow.imports.topics import Topics
from wrenchflow.signals import Signal


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _wrench(wrench: Any) -> tuple[float, ...]:
    return *_xyz(wrench.force), *_xyz(wrench.torque)


def _twist(twist: Any) -> tuple[float, ...]:
    return *_xyz(twist.linear), *_xyz(twist.angular)


def _pose(pose: Any) -> tuple[float, ...]:
    return *_xyz(pose.position), pose.orientation.w, *_xyz(pose.orientation)


@dataclass(frozen=True)
class _Type:
    """How a message becomes a row; `signal` is None where that depends on how many joints it has."""

    signal: Signal | None
    row: Callable[[Any], Sequence[float]]


def _joints(message: Any) -> tuple[float, ...]:
    measured = (message.position, message.velocity, message.effort)
    count = max(map(len, measured))
    # What a message leaves out nobody measured.
    return tuple(value for part in measured for value in (part if len(part) == count else [np.nan] * count))


_TYPES = {
    "geometry_msgs/msg/WrenchStamped": _Type(signals.WRENCH, lambda message: _wrench(message.wrench)),
    "geometry_msgs/msg/Wrench": _Type(signals.WRENCH, _wrench),
    "geometry_msgs/msg/Vector3Stamped": _Type(signals.FORCE, lambda message: _xyz(message.vector)),
    "geometry_msgs/msg/PoseStamped": _Type(signals.POSE, lambda message: _pose(message.pose)),
    "geometry_msgs/msg/Pose": _Type(signals.POSE, _pose),
    "geometry_msgs/msg/TransformStamped": _Type(
        signals.POSE,
        lambda message: (
            *_xyz(message.transform.translation),
            message.transform.rotation.w,
            *_xyz(message.transform.rotation),
        ),
    ),
    "geometry_msgs/msg/PointStamped": _Type(signals.POSITION, lambda message: _xyz(message.point)),
    "geometry_msgs/msg/TwistStamped": _Type(signals.TWIST, lambda message: _twist(message.twist)),
    "geometry_msgs/msg/Twist": _Type(signals.TWIST, _twist),
    "sensor_msgs/msg/JointState": _Type(None, _joints),
}


class BagTopics(Topics):
    """A bag."""

    def __init__(self, path: Path) -> None:
        """Look whether it can be opened.

        Raises:
            RecordingError: If it is missing or damaged, or no bag.
        """
        super().__init__(path.resolve().name, path)
        if not (path / "metadata.yaml").is_file():
            raise RecordingError(f"folder '{path}' is no ROS 2 bag: it has no metadata.yaml.")
        with self._opened() as reader:
            self._topics = {connection.topic: connection.msgtype for connection in reader.connections}

    def topic(self, name: str, where: str) -> TopicRows:
        """See `Take`."""
        if name not in self._topics:
            raise RecordingError(f"{where}: {unknown(f'topic of {self._path}', name, self._topics)}")
        message = self._topics[name]
        if message not in _TYPES:
            raise RecordingError(
                f"{where}: topic '{name}' of {self._path} is of type {unknown('message type', message, _TYPES)}"
            )
        signal, row = _TYPES[message].signal, _TYPES[message].row
        header_ns, log_ns, rows, frames = [], [], [], {}
        with self._opened() as reader:
            connections = [each for each in reader.connections if each.topic == name]
            for _, received_ns, data in reader.messages(connections):
                content: Any = reader.deserialize(data, message)
                header = getattr(content, "header", None)
                if header is not None:
                    header_ns.append(header.stamp.sec * 10**9 + header.stamp.nanosec)
                    frames[header.frame_id] = True
                log_ns.append(received_ns)
                rows.append(row(content))
        if not rows:
            raise RecordingError(f"{where}: topic '{name}' of {self._path} has no messages.")
        if len(frames) > 1 or len({len(each) for each in rows}) > 1:
            what = f"their frame: {', '.join(map(repr, frames))}" if len(frames) > 1 else "how many joints they have"
            raise RecordingError(f"{where}: the messages of topic '{name}' of {self._path} disagree on {what}.")
        signal = signal or signals.joints(len(rows[0]) // 3)
        return TopicRows(
            header_ns=np.array(header_ns, np.int64) if any(header_ns) else None,
            log_ns=np.array(log_ns, np.int64),
            data=np.array(rows, np.float64).reshape(len(rows), signal.width),
            signal=signal,
            frame=next(iter(frames), ""),
        )

    @contextmanager
    def _opened(self) -> Iterator[AnyReader]:
        try:
            with AnyReader([self._path], default_typestore=get_typestore(Stores.LATEST)) as reader:
                yield reader
        except (AnyReaderError, ReaderError, SerdeError, sqlite3.Error, OSError, ValueError, KeyError) as error:
            raise RecordingError(f"{self._path} cannot be read as a ROS 2 bag: {error}") from error
