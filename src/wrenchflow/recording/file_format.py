"""What makes an MCAP file one of ours: the version of its format, and the names in it that writer and reader share."""

import json
from collections.abc import Mapping
from typing import Any

from wrenchflow.errors import StreamError
from wrenchflow.signals import Signal

FORMAT_VERSION = 1
EVENTS = "events"
CLOCK_SYNC = "clock_sync"
# Metadata records: at the start, at the end, and where a file was recovered.
METADATA = "wrenchflow"
RESULT = "wrenchflow/result"
RECOVERED = "wrenchflow/recovered"
# What is known when an episode is over, as entries of the last of them: what came of it, what the safety layer did, how
# the recording went.
CLOSING = ("result", "safety", "recorded")
# Keeps the entries of an episode's `meta` apart from ours.
META_PREFIX = "meta."


def signal_of(entry: Mapping[str, Any]) -> Signal:
    """The signal that an entry of ours describes.

    Raises:
        KeyError: If it does not.
        StreamError: If it contradicts itself.
        TypeError: If it does not.
    """
    return Signal(entry["kind"], tuple(entry["columns"]), tuple(entry["units"]))


def readable(name: str, entries: Mapping[str, str]) -> dict[str, str]:
    """The entries of a metadata record that a reader will not stumble over; of another writer's record, all.

    Args:
        name: Of the record.
        entries: As they were found in a file that may be damaged. Without what says which streams there are, none is
            of use.
    """
    if name == METADATA and not _says_streams(entries):
        return {}
    if name not in (METADATA, RESULT):
        return dict(entries)
    as_text = {"format_version", "id", "task"}
    return {key: text for key, text in entries.items() if key in as_text or _is_json(text)}


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _says_streams(entries: Mapping[str, str]) -> bool:
    try:
        for of in json.loads(entries["streams"]).values():
            signal_of(of)
        return int(entries["format_version"]) > 0 and entries.keys() >= {"id", "task"}
    except (AttributeError, KeyError, TypeError, ValueError, StreamError):
        return False
