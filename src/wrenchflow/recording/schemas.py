"""Which ROS 2 message carries which signal: the definitions, and where in a message each column lies.

Only message types that every ROS 2 installation has, so that any tool can open and play the files. Inside wrenchflow a
quaternion is wxyz; in these messages it is xyzw, and `column_paths` is the one place where the two orders meet.
"""

from collections.abc import Container
from typing import Any

from mcap.well_known import MessageEncoding, SchemaEncoding

from wrenchflow import signals
from wrenchflow.errors import StreamError, unknown
from wrenchflow.messages import MessageType
from wrenchflow.signals import Signal

EVENT_MESSAGE = "std_msgs/msg/String"
IMAGE_MESSAGE = "sensor_msgs/msg/CompressedImage"
CLOCK_MESSAGE = "sensor_msgs/msg/TimeReference"

# The fields of each message in their order on the wire, as "type name"; `[]` marks a sequence.
FIELDS: dict[str, tuple[str, ...]] = {
    "builtin_interfaces/Time": ("int32 sec", "uint32 nanosec"),
    "std_msgs/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "std_msgs/String": ("string data",),
    "std_msgs/MultiArrayDimension": ("string label", "uint32 size", "uint32 stride"),
    "std_msgs/MultiArrayLayout": ("std_msgs/MultiArrayDimension[] dim", "uint32 data_offset"),
    "std_msgs/Float64MultiArray": ("std_msgs/MultiArrayLayout layout", "float64[] data"),
    "std_msgs/UInt8MultiArray": ("std_msgs/MultiArrayLayout layout", "uint8[] data"),
    "geometry_msgs/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Quaternion": ("float64 x", "float64 y", "float64 z", "float64 w"),
    "geometry_msgs/Pose": ("geometry_msgs/Point position", "geometry_msgs/Quaternion orientation"),
    "geometry_msgs/Twist": ("geometry_msgs/Vector3 linear", "geometry_msgs/Vector3 angular"),
    "geometry_msgs/Wrench": ("geometry_msgs/Vector3 force", "geometry_msgs/Vector3 torque"),
    "geometry_msgs/PoseStamped": ("std_msgs/Header header", "geometry_msgs/Pose pose"),
    "geometry_msgs/TwistStamped": ("std_msgs/Header header", "geometry_msgs/Twist twist"),
    "geometry_msgs/WrenchStamped": ("std_msgs/Header header", "geometry_msgs/Wrench wrench"),
    "geometry_msgs/PointStamped": ("std_msgs/Header header", "geometry_msgs/Point point"),
    "geometry_msgs/Vector3Stamped": ("std_msgs/Header header", "geometry_msgs/Vector3 vector"),
    "sensor_msgs/JointState": (
        "std_msgs/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    "sensor_msgs/CompressedImage": ("std_msgs/Header header", "string format", "uint8[] data"),
    "sensor_msgs/TimeReference": (
        "std_msgs/Header header",
        "builtin_interfaces/Time time_ref",
        "string source",
    ),
    "sensor_msgs/Joy": ("std_msgs/Header header", "float32[] axes", "int32[] buttons"),
}

# What no message has fields for: an array, whose label lists the columns.
_ARRAYS = {signal.kind: signal for signal in (signals.IMPEDANCE, signals.REQUEST, signals.GOVERNOR)}
_MESSAGE_OF_KIND = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "force": "geometry_msgs/msg/Vector3Stamped",
    "pose": "geometry_msgs/msg/PoseStamped",
    "position": "geometry_msgs/msg/PointStamped",
    "twist": "geometry_msgs/msg/TwistStamped",
    "velocity": "geometry_msgs/msg/Vector3Stamped",
    "joints": "sensor_msgs/msg/JointState",
    "joint_torque": "sensor_msgs/msg/JointState",
    **dict.fromkeys((*_ARRAYS, "plain"), "std_msgs/msg/Float64MultiArray"),
    "joy": "sensor_msgs/msg/Joy",
    "mask": "std_msgs/msg/UInt8MultiArray",
}
STREAM_MESSAGES = frozenset(_MESSAGE_OF_KIND.values())
_FIXED_SIGNALS = {
    "geometry_msgs/msg/WrenchStamped": signals.WRENCH,
    "geometry_msgs/msg/Vector3Stamped": signals.FORCE,
    "geometry_msgs/msg/PoseStamped": signals.POSE,
    "geometry_msgs/msg/PointStamped": signals.POSITION,
    "geometry_msgs/msg/TwistStamped": signals.TWIST,
}


def short_name(message: str) -> str:
    """The name inside definitions: `std_msgs/String` for `std_msgs/msg/String`."""
    return message.replace("/msg/", "/")


def has_header(message: str) -> bool:
    """Whether a message of ours, by its full name, carries a stamp and a frame."""
    return "std_msgs/Header header" in FIELDS[short_name(message)]


def definition(message: str) -> str:
    """The `ros2msg` schema text of a message: its own fields, then those of every type it is made of.

    Args:
        message: Full name, such as `geometry_msgs/msg/WrenchStamped`.
    """
    parts = [short_name(message)]
    for part in parts:  # The list grows while it is walked: breadth first, each type once.
        types = (field.split()[0].removesuffix("[]") for field in FIELDS[part])
        parts += [t for t in dict.fromkeys(types) if t in FIELDS and t not in parts]
    own, *others = ("".join(f"{field}\n" for field in FIELDS[part]) for part in parts)
    return own + "".join(f"{'=' * 80}\nMSG: {part}\n{text}" for part, text in zip(parts[1:], others, strict=True))


def message_of(signal: Signal) -> str:
    """The message type that carries a signal.

    Raises:
        StreamError: If the kind is not known, or its number of columns is not what the message holds.
    """
    if signal.kind not in _MESSAGE_OF_KIND:
        raise StreamError(unknown("signal kind", signal.kind, _MESSAGE_OF_KIND))
    if len(column_paths(signal)) != signal.width:
        raise StreamError(
            f"a '{signal.kind}' signal takes {len(column_paths(signal))} columns to be recorded, got {signal.width}."
        )
    return _MESSAGE_OF_KIND[signal.kind]


def message_type(message: str) -> MessageType:
    """A message type of ours, for topics that are no streams.

    Args:
        message: Full name.
    """
    return MessageType(
        name=message,
        definition=definition(message).encode(),
        schema_encoding=SchemaEncoding.ROS2,
        encoding=MessageEncoding.CDR,
    )


def _axes(*vectors: str) -> tuple[str, ...]:
    return tuple(f"{vector}.{axis}" for vector in vectors for axis in "xyz")


def _elements(count: int, *sequences: str) -> tuple[str, ...]:
    return tuple(f"{sequence}[{i}]" for sequence in sequences for i in range(count))


def _button_count(signal: Signal) -> int:
    return sum(column.startswith("button") for column in signal.columns)


def column_paths(signal: Signal) -> tuple[str, ...]:
    """Where each column of a signal lies in its message, such as `wrench.force.x`, in the order of the columns."""
    match signal.kind:
        case "wrench":
            return _axes("wrench.force", "wrench.torque")
        case "force" | "velocity":
            return _axes("vector")
        case "position":
            return _axes("point")
        case "pose":
            return (*_axes("pose.position"), "pose.orientation.w", *_axes("pose.orientation"))
        case "twist":
            return _axes("twist.linear", "twist.angular")
        case "joints":
            return _elements(signal.width // 3, "position", "velocity", "effort")
        case "joint_torque":
            return _elements(signal.width, "effort")
        case "joy":
            buttons = _button_count(signal)
            return _elements(signal.width - buttons, "axes") + _elements(buttons, "buttons")
        case _:
            return _elements(signal.width, "data")


def blank_message(signal: Signal, frame: str) -> dict[str, Any]:
    """A message of the right sizes and constants; fields that are left out are zero.

    Args:
        signal: What the message carries.
        frame: For `header.frame_id`, where the message has a header.
    """
    header = {"frame_id": frame}
    match signal.kind:
        case "joints" | "joint_torque":
            count = signal.width // 3 if signal.kind == "joints" else signal.width
            names = [f"panda_joint{i + 1}" for i in range(count)]
            measured = [0.0] * count if signal.kind == "joints" else []
            return {
                "header": header,
                "name": names,
                "position": measured,
                "velocity": measured,
                "effort": [0.0] * count,
            }
        case "joy":
            buttons = _button_count(signal)
            return {"header": header, "axes": [0.0] * (signal.width - buttons), "buttons": [0] * buttons}
        case kind if kind in ("mask", "plain") or kind in _ARRAYS:
            # One dimension, whose label lists the columns, so that sizes still multiply to the length of the data.
            columns = {"label": ",".join(signal.columns), "size": signal.width, "stride": signal.width}
            return {"layout": {"dim": [columns]}, "data": [0] * signal.width}
        case _:
            return {"header": header}


def infer_signal(message: str, paths: Container[str], label: str) -> Signal | None:
    """What a message of another writer measures, as far as its type and sizes tell.

    Args:
        message: Full name of its type.
        paths: The leaves that the message has, such as `position[0]`.
        label: Label of the first dimension of a multi-array, else empty.

    Returns:
        The signal, or None if nothing says what the numbers mean.
    """
    if message in _FIXED_SIGNALS:
        return _FIXED_SIGNALS[message]

    def length(sequence: str) -> int:
        count = 0
        while f"{sequence}[{count}]" in paths:
            count += 1
        return count

    match message:
        case "sensor_msgs/msg/JointState":
            measured = max(length("position"), length("velocity"))
            return (
                signals.joints(max(measured, length("effort"))) if measured else signals.joint_torque(length("effort"))
            )
        case "sensor_msgs/msg/Joy":
            axes, buttons = length("axes"), length("buttons")
            if (axes, buttons) == (6, 2):
                return signals.JOY
            columns = tuple(f"axis{i + 1}" for i in range(axes)) + tuple(f"button{i + 1}" for i in range(buttons))
            return Signal("joy", columns, ("1",) * len(columns))
        case "std_msgs/msg/UInt8MultiArray":
            columns = tuple(label.split(","))
            count = length("data")
            return signals.mask(columns if len(columns) == count else tuple(f"flag{i + 1}" for i in range(count)))
        case _:
            return next((signal for signal in _ARRAYS.values() if label == ",".join(signal.columns)), None)
