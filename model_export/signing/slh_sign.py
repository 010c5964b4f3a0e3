"""SLH-DSA, the signing half (FIPS 205, set SHA2-128s): deterministic, without state.

Pure functions of the key. The same key and message give the same signature, whoever signs, however often.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import slh_dsa
from palpate.model_export.signing import slh_kernels as kernels

N = slh_dsa.N
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Secret:
    """A private key: two secret seeds and the public one, 16 bytes each, and the number of its set."""

    seed: bytes
    prf: bytes
    public_seed: bytes
    set: int = 1

    @classmethod
    def draw(cls) -> Secret:
        """A new one, from the operating system."""
        seed, prf, public_seed = (secrets.token_bytes(N) for _ in range(3))
        return cls(seed, prf, public_seed)

    @property
    def content(self) -> dict[str, Any]:
        """What a file holds of it."""
        return {"set": self.set, "seeds": (self.seed + self.prf + self.public_seed).hex()}

    @classmethod
    def read(cls, content: dict[str, Any], public: bytes) -> Secret:
        """The private key of `content`; ValueError, KeyError or TypeError where it is none of `public`'s."""
        seeds = bytes.fromhex(content["seeds"])
        secret = cls(seeds[:N], seeds[N : 2 * N], seeds[2 * N :], content["set"])
        known = slh_dsa.parameters(public) and public[3] == secret.set
        if len(seeds) != 3 * N or not known or public[4 : 4 + N] != secret.public_seed:
            raise ValueError
        return secret

    @property
    def parameters(self) -> tuple[int, int, int, int]:
        """Layers of trees, their height, few-time trees, their height."""
        layers, height, trees, depth = slh_dsa.SETS[self.set]
        return layers, height, trees, depth


def _array(data: bytes) -> Bytes:
    return np.frombuffer(data, np.uint8)


def _state(secret: Secret) -> NDArray[np.int64]:
    """SHA-256 after the block that every node's hash begins with."""
    out = np.empty(8, np.int64)
    block = np.zeros(64, np.int64)
    block[:N] = _array(secret.public_seed)
    kernels.compress(kernels.START, block, np.empty(64, np.int64), out)
    return out


def _address(layer: int, tree: int) -> Bytes:
    address = np.zeros(22, np.uint8)
    address[0] = layer
    address[1:9] = _array(tree.to_bytes(8, "big"))
    return address


def public_key(secret: Secret) -> bytes:
    """What a probe keeps: "SLH", the set's number, seed and root."""
    layers, height, _, _ = secret.parameters
    nodes = kernels.tree(_state(secret), _array(secret.seed), _address(layers - 1, 0), height)
    return b"SLH" + bytes((secret.set,)) + secret.public_seed + nodes[1].tobytes()


def _digits(node: bytes) -> NDArray[np.int64]:
    digits = [d for byte in node for d in (byte >> 4, byte & 15)]
    total = sum(15 - d for d in digits)
    return np.array([*digits, total >> 8, total >> 4 & 15, total & 15])


def _path(nodes: Bytes, index: int) -> bytes:
    """The neighbours on the way from a leaf to the root."""
    at, out = len(nodes) // 2 + index, b""
    while at > 1:
        out += nodes[at ^ 1].tobytes()
        at >>= 1
    return out


def sign(secret: Secret, public: bytes, message: bytes, context: bytes) -> bytes:
    """Signature of a message for a purpose, as `firmware_py.signature.MODEL`."""
    layers, height, trees, depth = secret.parameters
    state, seed = _state(secret), _array(secret.seed)
    whole = bytes((0, len(context))) + context + message
    r = hmac.digest(secret.prf, secret.public_seed + whole, "sha256")[:N]
    inner = hashlib.sha256(r + public[4:] + whole).digest()
    digest = hashlib.sha256(r + secret.public_seed + inner + bytes(4)).digest()
    few, tree_bits = (trees * depth + 7) // 8, height * (layers - 1)
    middle = few + (tree_bits + 7) // 8
    tree = int.from_bytes(digest[few:middle], "big") % (1 << tree_bits)
    leaf = int.from_bytes(digest[middle : middle + (height + 7) // 8], "big") % (1 << height)

    picks = int.from_bytes(digest[:few], "big") >> 8 * few - trees * depth
    address = _address(0, tree)
    out, roots = [r], []
    for i in range(trees):
        pick = picks >> depth * (trees - 1 - i) & (1 << depth) - 1
        leaves, nodes = kernels.few_times_tree(state, seed, address, leaf, i, depth)
        out += [leaves[pick].tobytes(), _path(nodes, pick)]
        roots.append(nodes[1].tobytes())
    address[9:] = 0
    address[9] = 4
    address[10:14] = _array(leaf.to_bytes(4, "big"))
    message_node = np.empty(N, np.uint8)
    kernels.node(state, address, _array(b"".join(roots)), message_node, np.zeros(144, np.int64))
    node = message_node.tobytes()
    for layer in range(layers):
        address = _address(layer, tree)
        out.append(kernels.one_time_signature(state, seed, address, leaf, _digits(node)).tobytes())
        nodes = kernels.tree(state, seed, _address(layer, tree), height)
        out.append(_path(nodes, leaf))
        node = nodes[1].tobytes()
        leaf, tree = tree & (1 << height) - 1, tree >> height
    return b"".join(out)
