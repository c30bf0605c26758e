"""How chunks are compressed, and how they are decompressed without believing what they say of their size."""

from collections.abc import Callable

import lz4.frame
import numpy as np
import zstandard

from wrenchflow.errors import ConfigError, RecordingError, unknown

NAMES = ("zstd", "lz4", "none")
MAX_CHUNK_BYTES = 256 * 1024 * 1024  # Nobody writes chunks of this size; who claims it is broken, or an enemy.
_PIECE_BYTES = 1024 * 1024


def compressor(name: str) -> Callable[[memoryview], bytes | memoryview]:
    """What compresses a chunk.

    zstd is at level -3 with a larger hash table: numbers that were measured have little but noise below their
    exponents, which entropy coding does not make smaller. Against level 1, recordings of the simulated arm take 2 to
    5 % more bytes, are written one and a half times as fast, and read twice as fast.

    Raises:
        ConfigError: If `name` is none of `NAMES`.
    """
    match name:
        case "zstd":
            options = zstandard.ZstdCompressionParameters.from_level(-3, hash_log=13)
            return zstandard.ZstdCompressor(compression_params=options).compress
        case "lz4":
            return lambda data: lz4.frame.compress(data)
        case "none":
            return lambda data: data
        case _:
            raise ConfigError(unknown("compression", name, NAMES))


def decompress(data: memoryview, name: str, limit: int) -> bytes | memoryview:
    """What a chunk holds, or as much of it as can be had if it was cut off or damaged.

    Args:
        data: Compressed bytes.
        name: As the chunk says: `zstd`, `lz4` or nothing.
        limit: Stop after this many bytes.

    Raises:
        RecordingError: If `name` is another.
    """
    match name:
        case "" | "none":
            return data[:limit]
        case "zstd":
            whole = _whole_frame(data, limit)
            if whole is not None:
                return whole
            # A frame may ask for a window of gigabytes; ours and everybody's need megabytes.
            reader = zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(data)
            return _collect(lambda size: reader.read(size), limit, zstandard.ZstdError)
        case "lz4":
            frame = lz4.frame.LZ4FrameDecompressor()
            fed = [data]

            def read(size: int) -> bytes:
                return b"" if frame.eof else frame.decompress(fed.pop() if fed else b"", max_length=size)

            return _collect(read, limit, (RuntimeError, EOFError))
        case other:
            raise RecordingError(f"compression '{other[:40]}' cannot be read. Readable: zstd, lz4 and none.")


def _whole_frame(data: memoryview, size: int) -> bytes | None:
    """A frame that says `size` and keeps its word, in one go, which is faster than in pieces; None for any other."""
    try:
        if zstandard.frame_content_size(data) != size:
            return None
        return zstandard.ZstdDecompressor(max_window_size=2**27).decompress(data)
    except (zstandard.ZstdError, MemoryError):
        return None


def _collect(
    read: Callable[[int], bytes], limit: int, broken: type[Exception] | tuple[type[Exception], ...]
) -> memoryview:
    content = np.empty(limit, np.uint8)  # A page takes memory once something is written to it.
    size = 0
    while size < limit:
        try:
            piece = read(min(limit - size, _PIECE_BYTES))
        except broken:
            break
        if not piece:
            break
        content[size : size + len(piece)] = np.frombuffer(piece, np.uint8)
        size += len(piece)
    return content[:size].data.toreadonly()
