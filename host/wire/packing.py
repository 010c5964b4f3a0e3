"""A frame's counts of 12 bits, two in three bytes (docs/protocol.md, "Frame")."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def pack(counts: NDArray[Any]) -> bytes:
    """Pack counts of 12 bits, two in three bytes."""
    v = np.asarray(counts).astype(np.uint16).reshape(-1, 2)
    out = np.empty((len(v), 3), np.uint8)
    out[:, 0] = v[:, 0] & 255
    out[:, 1] = v[:, 0] >> 8 | (v[:, 1] & 15) << 4
    out[:, 2] = v[:, 1] >> 4
    return out.tobytes()


def unpack(packed: bytes) -> NDArray[np.uint16]:
    """The counts of a packed frame (docs/protocol.md, "Frame"), shape (cells,)."""
    triples = np.frombuffer(packed, np.uint8).reshape(-1, 3).astype(np.uint16)
    counts = np.empty((len(triples), 2), np.uint16)
    counts[:, 0] = triples[:, 0] | (triples[:, 1] & 15) << 8
    counts[:, 1] = triples[:, 1] >> 4 | triples[:, 2] << 4
    return counts.ravel()
