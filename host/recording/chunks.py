"""The chunks of a sealed recording: unpacked within limits, checked, and as far as they can be read."""

from __future__ import annotations

import zlib

import zstandard
from mcap.records import Chunk

LARGEST_CHUNK = 1 << 24
"""Bytes that a chunk may unpack to; ours have a quarter of a MiB."""

EXPANSION = 1000
"""A chunk may unpack to so many times its own size; those of a probe unpack to three times."""

_ROOM = 64  # of a packed chunk, bytes that carry nothing
_PIECE = 1 << 16


def unpack(chunk: Chunk) -> tuple[bytes, str]:
    """A chunk's records, and what is wrong with them: "" where they are as they were written.

    Parameters
    ----------
    chunk : Chunk
        Whatever size it declares, not more than `LARGEST_CHUNK` is unpacked, nor `EXPANSION` times its own.
    """
    if chunk.compression and chunk.uncompressed_size > EXPANSION * (len(chunk.data) + _ROOM):
        return b"", f"a chunk unpacks to over {EXPANSION} times its size"
    if chunk.uncompressed_size > LARGEST_CHUNK:
        return b"", f"a chunk declares {chunk.uncompressed_size / 1e6:.0f} MB"
    if chunk.compression == "zstd":
        data, wrong = _zstd(chunk.data, chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data, wrong = _lz4(chunk.data, chunk.uncompressed_size)
    elif not chunk.compression:
        data, wrong = chunk.data, ""
    else:
        return b"", "a chunk is compressed in a way that is not known here"
    if wrong:
        return data, wrong
    if len(data) != chunk.uncompressed_size:
        return data, "a chunk has another length than it says"
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        return data, "a chunk's checksum does not match"
    return data, ""


def _zstd(packed: bytes, size: int) -> tuple[bytes, str]:
    """Piece by piece, so that what stands before damage is had, and no more memory taken than allowed."""
    data = bytearray()
    unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)
    try:
        with unpacker.stream_reader(packed) as stream:
            while len(data) <= size and (piece := stream.read(_PIECE)):
                data += piece
    except (zstandard.ZstdError, MemoryError):
        return bytes(data), "a chunk cannot be unpacked"
    return bytes(data), ""


def _lz4(packed: bytes, size: int) -> tuple[bytes, str]:
    import lz4.frame

    try:
        return lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1), ""
    except (RuntimeError, EOFError, MemoryError):
        return b"", "a chunk cannot be unpacked"
