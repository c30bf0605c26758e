"""An episode, or a part of one, to Rerun: whole columns at once, on the recording's own clock."""

from collections.abc import Sequence
from itertools import batched

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Float, Int64

from wrenchflow.episode import Episode, Event
from wrenchflow.recording.images import images_of
from wrenchflow.view import style
from wrenchflow.view.contents import EVENTS, FORCE, PATH, TIMELINE, WORLD, Contents, series_of

APPLICATION = "wrenchflow"
_PATH_POINTS = 2000  # More than a screen shows of a path.
_IMAGES_AT_ONCE = 256


def log_episode(recording: rr.RecordingStream, episode: Episode, contents: Contents) -> None:
    """Log all of an episode that can be seen.

    Args:
        recording: Where it goes.
        episode: Streams, events and images; other messages are passed over.
        contents: Of this episode.

    Raises:
        RecordingError: If an image cannot be read.
    """
    log_start(recording, contents, episode.span_ns[0])
    for name, stream in episode.streams.items():
        log_samples(recording, contents, name, stream.t, stream.data)
    if contents.body is not None and len(episode[contents.body]):
        positions = episode[contents.body].data[:, :3]
        path = style.path_of(positions[:: max(1, len(positions) // _PATH_POINTS)])
        recording.log(PATH, path, static=True)
    for kind in dict.fromkeys(event.kind for event in episode.events):
        log_lane(recording, kind, episode.events_of(kind))
    for name in contents.cameras:
        messages = episode.messages[name]
        images = zip(messages.t.tolist(), images_of(messages), strict=True)
        for some in batched(images, _IMAGES_AT_ONCE):
            log_images(recording, name, [t_ns for t_ns, _ in some], [bytes(image.data) for _, image in some])


def log_start(recording: rr.RecordingStream, contents: Contents, start_ns: int) -> None:
    """Log what does not change: the name of the recording, when it began [ns], and how everything looks."""
    recording.send_recording_name(contents.id)
    recording.send_recording_start_time_nanos(start_ns)
    style.log_styles(recording, contents)


def log_samples(
    recording: rr.RecordingStream,
    contents: Contents,
    name: str,
    t: Int64[np.ndarray, " n"],
    data: Float[np.ndarray, "n d"],
) -> None:
    """Log samples of a stream: its plots, and what they mean in space.

    Args:
        recording: Where they go.
        contents: Of the episode.
        name: Of the stream.
        t: Time stamps [ns]. Shape (n,).
        data: Rows of its signal. Shape (n, d).
    """
    if not len(t):
        return
    time = [_times(t)]
    for series in series_of(name, contents.streams[name][0]):
        columns = data[:, list(series.columns)]
        recording.send_columns(series.entity, time, rr.Scalars.columns(scalars=columns))
    if name in contents.poses:
        pose = rr.Transform3D.columns(translation=data[:, :3], quaternion=data[:, [4, 5, 6, 3]])
        recording.send_columns(f"{WORLD}/{name}", time, pose)
    if name == "tcp_pose" and contents.arrow_entity == FORCE:
        recording.send_columns(FORCE, time, rr.Transform3D.columns(translation=data[:, :3]))
    if name == contents.arrow:
        arrows = rr.Arrows3D.columns(vectors=data[:, :3] * style.ARROW_M_PER_N)
        recording.send_columns(contents.arrow_entity, time, arrows)


def log_images(recording: rr.RecordingStream, name: str, t_ns: Sequence[int], pictures: Sequence[bytes]) -> None:
    """Log compressed images of a camera; Rerun tells JPEG from PNG by their first bytes.

    Args:
        recording: Where they go.
        name: Of the topic.
        t_ns: When each was taken [ns].
        pictures: Their files.
    """
    recording.send_columns(f"/{name}", [_times(np.array(t_ns))], rr.EncodedImage.columns(blob=pictures))


def log_lane(recording: rr.RecordingStream, kind: str, events: Sequence[Event]) -> None:
    """Log the events of one kind as a lane of states; one without an extent, such as a success, lasts to the end.

    Args:
        recording: Where they go.
        kind: Of the events.
        events: In order of their start.
    """
    recording.log(f"{EVENTS}/{kind}", style.states_of(kind, events), static=True)
    edges = sorted({edge for event in events for edge in (event.start_ns, event.stop_ns)})
    states = []
    for edge in edges:
        now = [event for event in events if event.start_ns <= edge and (edge < event.stop_ns or _is_instant(event))]
        states.append(" + ".join(dict.fromkeys(event.label or kind for event in now)) or None)
    changes = rr.StateChange.columns(state=pa.array(states, pa.string()))
    recording.send_columns(f"{EVENTS}/{kind}", [_times(np.array(edges))], changes)


def _is_instant(event: Event) -> bool:
    return event.start_ns == event.stop_ns


def _times(t: Int64[np.ndarray, " n"]) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, timestamp=t.astype("datetime64[ns]"))
