"""LMS signatures, the signing half: keys grown from a seed as RFC 8554, appendix A, does.

Pure functions of the key; which leaf may be used is `keys.py`'s business.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from firmware_py import lms

# (node size, height): type number; (node size, bits a digit): one-time type number (RFC 8554, RFC 9858)
HEIGHTS = {(32, 5): 5, (32, 10): 6, (32, 15): 7, (24, 5): 10, (24, 10): 11, (24, 15): 12}
WIDTHS = {(32, 1): 1, (32, 2): 2, (32, 4): 3, (32, 8): 4, (24, 1): 5, (24, 2): 6, (24, 4): 7, (24, 8): 8}


@dataclass(frozen=True)
class Secret:
    """A private key: seed (as long as a node), identifier (16 bytes), height, bits a digit, node size."""

    seed: bytes
    ident: bytes
    height: int
    width: int
    size: int = 32

    @property
    def types(self) -> bytes:
        """Type and one-time type, as in the public key."""
        numbers = HEIGHTS[self.size, self.height], WIDTHS[self.size, self.width]
        return b"".join(number.to_bytes(4, "big") for number in numbers)

    def parameters(self) -> tuple[int, int, int, int, int]:
        """(node size, height, bits a digit, digits, checksum's shift)."""
        found = lms.parameters(self.types + bytes(16 + self.size))
        assert found is not None
        return found


def _sha(secret: Secret, *parts: bytes) -> bytes:
    return hashlib.sha256(secret.ident + b"".join(parts)).digest()[: secret.size]


def _start(secret: Secret, leaf: bytes, digit: int) -> bytes:
    """Private element of one digit's chain (RFC 8554, appendix A)."""
    return _sha(secret, leaf, digit.to_bytes(2, "big"), b"\xff", secret.seed)


def _walk(secret: Secret, leaf: bytes, digit: int, node: bytes, first: int, last: int) -> bytes:
    head = secret.ident + leaf + digit.to_bytes(2, "big")
    sha256, size = hashlib.sha256, secret.size
    for step in range(first, last):
        node = sha256(head + bytes((step,)) + node).digest()[:size]
    return node


def leaf_node(secret: Secret, number: int) -> bytes:
    """Node of the tree's leaf: hash of the leaf's one-time public key."""
    _, height, width, digits, _ = secret.parameters()
    leaf = number.to_bytes(4, "big")
    most = (1 << width) - 1
    ends = [_walk(secret, leaf, i, _start(secret, leaf, i), 0, most) for i in range(digits)]
    key = _sha(secret, leaf, b"\x80\x80", *ends)
    return _sha(secret, ((1 << height) + number).to_bytes(4, "big"), b"\x82\x82", key)


def tree(secret: Secret, leaves: list[bytes]) -> list[bytes]:
    """All nodes by number (entry 0 unused, entry 1 the root)."""
    count = 1 << secret.height
    nodes = [b""] * count + leaves
    for number in range(count - 1, 0, -1):
        pair = nodes[2 * number] + nodes[2 * number + 1]
        nodes[number] = _sha(secret, number.to_bytes(4, "big"), b"\x83\x83", pair)
    return nodes


def public_key(secret: Secret, nodes: list[bytes]) -> bytes:
    """What a probe keeps."""
    return secret.types + secret.ident + nodes[1]


def sign(secret: Secret, nodes: list[bytes], number: int, message: bytes, randomizer: bytes) -> bytes:
    """Signature of a message with leaf `number`, which must never be used again."""
    _, height, width, digits, shift = secret.parameters()
    leaf = number.to_bytes(4, "big")
    q = _sha(secret, leaf, b"\x81\x81", randomizer, message)
    values = lms.digits_of(q, width, digits, shift)
    chains = [_walk(secret, leaf, i, _start(secret, leaf, i), 0, values[i]) for i in range(digits)]
    path = []
    at = (1 << height) + number
    while at > 1:
        path.append(nodes[at ^ 1])
        at >>= 1
    return b"".join((leaf, secret.types[4:], randomizer, *chains, secret.types[:4], *path))
