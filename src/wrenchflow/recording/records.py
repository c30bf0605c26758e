"""Message records in the bytes of a chunk: found, checked and taken apart by compiled loops.

A record may lie at any byte. So the loops get the chunk as words too: `words[i]` is the number that the eight bytes
from byte i on make up, which `words_of` makes without a copy. All places are unsigned, so that no access has to look
whether it counts from the end.
"""

import numpy as np
from jaxtyping import UInt8, UInt64

from wrenchflow.compiled import kernel

_MESSAGE = 0x05
_PREFIX = np.uint64(9)  # Opcode and length, which the length does not count.
_HEADER = np.uint64(31)  # Up to the first byte of the message itself.
_CHANNEL, _SEQUENCE, _LOG_TIME, _PUBLISH_TIME = np.uint64(9), np.uint64(11), np.uint64(15), np.uint64(23)
_ONE, _EIGHT, _HALF = np.uint64(1), np.uint64(8), np.uint64(32)
_LOW_16, _LOW_32 = np.uint64(2**16 - 1), np.uint64(2**32 - 1)


def words_of(data: UInt8[np.ndarray, " size"]) -> UInt64[np.ndarray, " words"]:
    """The eight bytes from every byte on as a little-endian number; of fewer than eight bytes there is none."""
    return np.ndarray(max(len(data) - 7, 0), "<u8", data, strides=(1,))


@kernel
def count_records(data, words, counts):
    """Count the messages of each channel.

    Args:
        data: The uncompressed chunk. Shape (size,).
        words: The same as words.
        counts: One a channel; added to. Shape (65536,).

    Returns:
        How many other records there are, and where a record is cut off, else -1.
    """
    at, others, size = np.uint64(0), 0, np.uint64(len(data))
    while at < size:
        if size - at < _PREFIX:
            return others, np.int64(at)
        length = words[at + _ONE]
        if length > size - at - _PREFIX:
            return others, np.int64(at)
        if data[at] != _MESSAGE:
            others += 1
        elif length < _HEADER - _PREFIX:
            return others, np.int64(at)
        else:
            counts[words[at + _CHANNEL] & _LOW_16] += 1
        at += _PREFIX + length
    return others, np.int64(-1)


@kernel
def index_records(data, words, places, index, others):
    """Note where each record starts, after `count_records` has found all of them whole.

    Args:
        data: The uncompressed chunk. Shape (size,).
        words: The same as words.
        places: First row of each channel in `index`; it is the first after the channel afterwards. Shape (65536,).
        index: Log time [ns] and offset of each message, channel after channel. Shape (n, 2).
        others: Offset of each record that is no message. Shape (m,).
    """
    at, seen, size = np.uint64(0), 0, np.uint64(len(data))
    while at < size:
        if data[at] == _MESSAGE:
            channel = words[at + _CHANNEL] & _LOW_16
            index[places[channel], 0] = words[at + _LOG_TIME]
            index[places[channel], 1] = at
            places[channel] += 1
        else:
            others[seen] = at
            seen += 1
        at += _PREFIX + words[at + _ONE]


@kernel
def read_headers(data, words, offsets, channel, received, t, sequence, starts, lengths):
    """Read what precedes each message.

    Args:
        data: The uncompressed chunk. Shape (size,).
        words: The same as words.
        offsets: Where each record starts. Shape (n,).
        channel: Whose messages they must be.
        received: Log time of each [ns]; written. Shape (n,).
        t: Publish time of each [ns]; written. Shape (n,).
        sequence: Number of each; written. Shape (n,).
        starts: Where the message itself starts; written. Shape (n,).
        lengths: How long it is; written. Shape (n,).

    Returns:
        How many of the first are messages of that channel and whole.
    """
    size = np.uint64(len(data))
    for i in range(len(offsets)):
        at = offsets[i]
        if at > size or size - at < _HEADER or data[at] != _MESSAGE:
            return i
        length = words[at + _ONE]
        if length < _HEADER - _PREFIX or length > size - at - _PREFIX or words[at + _CHANNEL] & _LOW_16 != channel:
            return i
        sequence[i] = words[at + _SEQUENCE] & _LOW_32
        received[i] = words[at + _LOG_TIME]
        t[i] = words[at + _PUBLISH_TIME]
        starts[i] = at + _HEADER
        lengths[i] = length - (_HEADER - _PREFIX)
    return len(offsets)


# How a number is stored, as `take_samples` is told.
FLOAT64, FLOAT32, INT32, UINT32, UINT8 = range(5)


@kernel
def _value(data, at, kind, width, is_big):
    """The number of one of the kinds above whose first byte is at `at`."""
    scratch = np.zeros(8, np.uint8)
    for j in range(width):
        scratch[j] = data[at + (width - _ONE - j if is_big else j)]
    if kind == FLOAT64:
        return scratch.view(np.float64)[0]
    if kind == FLOAT32:
        return np.float64(scratch.view(np.float32)[0])
    if kind == INT32:
        return np.float64(scratch.view(np.int32)[0])
    if kind == UINT32:
        return np.float64(scratch.view(np.uint32)[0])
    return np.float64(scratch[0])


@kernel
def take_samples(data, words, offsets, size, constant, runs, stamp, stamps, publish, rows):
    """Take records apart that differ from a template only where they may.

    Args:
        data: The uncompressed chunk. Shape (size,).
        words: The same as words.
        offsets: Where each record starts. Shape (n,).
        size: Bytes of a record.
        constant: What may not differ, as words: where one starts, its bits, and which of them count. Shape (k, 3).
        runs: For each run of columns: its first byte, its first column, how many columns, how each is stored, how many
            bytes each takes, and whether the most significant comes first. Shape (m, 6).
        stamp: First byte of the seconds of the header's stamp, where the nanoseconds follow, and whether the most
            significant comes first. Shape (2,), or (0,) without a header.
        stamps: The header's stamp, or the publish time [ns]; written. Shape (n,).
        publish: Publish time [ns]; written. Shape (n,).
        rows: The values; what no run holds stays as it is; written. Shape (n, d).

    Returns:
        How many of the first match. The rest is not written.
    """
    stop = np.uint64(len(data))
    row_words = rows.view(np.uint64)
    for i in range(len(offsets)):
        at = offsets[i]
        if at > stop or stop - at < size:
            return i
        difference = np.uint64(0)
        for part in range(len(constant)):
            difference |= (words[at + constant[part, 0]] ^ constant[part, 1]) & constant[part, 2]
        if difference:
            return i
        publish[i] = words[at + _PUBLISH_TIME]
        stamps[i] = publish[i]
        if len(stamp):
            first = at + stamp[0]
            if stamp[1]:
                seconds = np.int64(_value(data, first, INT32, np.uint64(4), True))
                nanoseconds = np.int64(_value(data, first + np.uint64(4), UINT32, np.uint64(4), True))
            else:
                seconds = np.int64(np.int32(words[first] & _LOW_32))
                nanoseconds = np.int64(words[first] >> _HALF)
            stamps[i] = seconds * 1_000_000_000 + nanoseconds
        for run in range(len(runs)):
            source, column, count = at + runs[run, 0], runs[run, 1], runs[run, 2]
            kind, width, is_big = runs[run, 3], runs[run, 4], runs[run, 5]
            if kind == FLOAT64 and not is_big:
                for item in range(count):
                    row_words[i, column + item] = words[source + _EIGHT * item]
            else:
                for item in range(count):
                    rows[i, column + item] = _value(data, source + item * width, kind, width, is_big)
    return len(offsets)
