"""LMS signatures (RFC 8554), the signing half: keys grown from a seed by the RFC's Appendix A.

Pure functions of the key; which leaf may be used is `keys.py`'s business.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from firmware_py import lms

HEIGHTS = {5: 5, 10: 6, 15: 7}  # height: RFC type number (LMS_SHA256_M32_H..)
WIDTHS = {1: 1, 2: 2, 4: 3, 8: 4}  # bits a digit: RFC one-time type number (LMOTS_SHA256_N32_W..)


@dataclass(frozen=True)
class Secret:
    """A private key: seed (32 bytes), identifier (16 bytes), tree height, bits a digit."""

    seed: bytes
    ident: bytes
    height: int
    width: int

    @property
    def types(self) -> bytes:
        """Type and one-time type, as in the public key."""
        return HEIGHTS[self.height].to_bytes(4, "big") + WIDTHS[self.width].to_bytes(4, "big")

    def parameters(self) -> tuple[int, int, int, int]:
        """(height, bits a digit, digits, checksum's shift)."""
        found = lms.parameters(self.types + bytes(48))
        assert found is not None
        return found


def _sha(*parts: bytes) -> bytes:
    return hashlib.sha256(b"".join(parts)).digest()


def _start(secret: Secret, leaf: bytes, digit: int) -> bytes:
    """Private element of one digit's chain (RFC 8554, appendix A)."""
    return _sha(secret.ident, leaf, digit.to_bytes(2, "big"), b"\xff", secret.seed)


def _walk(secret: Secret, leaf: bytes, digit: int, node: bytes, first: int, last: int) -> bytes:
    head = secret.ident + leaf + digit.to_bytes(2, "big")
    sha256 = hashlib.sha256
    for step in range(first, last):
        node = sha256(head + bytes((step,)) + node).digest()
    return node


def leaf_node(secret: Secret, number: int) -> bytes:
    """Node of the tree's leaf: hash of the leaf's one-time public key."""
    height, width, digits, _ = secret.parameters()
    leaf = number.to_bytes(4, "big")
    most = (1 << width) - 1
    ends = [_walk(secret, leaf, i, _start(secret, leaf, i), 0, most) for i in range(digits)]
    key = _sha(secret.ident, leaf, b"\x80\x80", *ends)
    return _sha(secret.ident, ((1 << height) + number).to_bytes(4, "big"), b"\x82\x82", key)


def tree(secret: Secret, leaves: list[bytes]) -> list[bytes]:
    """All nodes by number (entry 0 unused, entry 1 the root)."""
    count = 1 << secret.height
    nodes = [b""] * count + leaves
    for number in range(count - 1, 0, -1):
        pair = nodes[2 * number] + nodes[2 * number + 1]
        nodes[number] = _sha(secret.ident, number.to_bytes(4, "big"), b"\x83\x83", pair)
    return nodes


def public_key(secret: Secret, nodes: list[bytes]) -> bytes:
    """The 56 bytes that a probe keeps."""
    return secret.types + secret.ident + nodes[1]


def sign(secret: Secret, nodes: list[bytes], number: int, message: bytes, randomizer: bytes) -> bytes:
    """Signature of a message with leaf `number`, which must never be used again."""
    height, width, digits, shift = secret.parameters()
    leaf = number.to_bytes(4, "big")
    q = _sha(secret.ident, leaf, b"\x81\x81", randomizer, message)
    values = lms.digits_of(q, width, digits, shift)
    chains = [_walk(secret, leaf, i, _start(secret, leaf, i), 0, values[i]) for i in range(digits)]
    path = []
    at = (1 << height) + number
    while at > 1:
        path.append(nodes[at ^ 1])
        at >>= 1
    return b"".join((leaf, secret.types[4:], randomizer, *chains, secret.types[:4], *path))
