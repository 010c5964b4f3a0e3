"""LMS on the probe and on the host, against RFC 8554's vectors and an independent implementation."""

from __future__ import annotations

import pyhsslms
import pytest

from firmware_py import lms, status
from model_export import lms_sign
from tests.image import rfc8554 as rfc


def verify(key: bytes, signed: bytes) -> int:
    return lms.verify(key, lambda at, n: signed[at : at + n], len(signed))


@pytest.mark.parametrize(
    ("key", "message", "signature"),
    [
        (rfc.CASE1_ROOT, rfc.CASE1_LOWER, rfc.CASE1_UPPER_SIGNATURE),
        (rfc.CASE1_LOWER, rfc.CASE1_MESSAGE, rfc.CASE1_SIGNATURE),
    ],
)
def test_rfc_case_1_verifies_and_nothing_else_does(key, message, signature):
    assert lms.signature_size(key) == len(signature)
    assert verify(key, message + signature) == status.OK
    assert verify(key, message[:-1] + b"?" + signature) == status.BAD_SIGNATURE
    other = key[:-1] + bytes((key[-1] ^ 1,))
    assert verify(other, message + signature) == status.BAD_SIGNATURE


def grow(seed: bytes, ident: bytes, height: int, width: int, size: int = 32):
    secret = lms_sign.Secret(seed, ident, height, width, size)
    return secret, lms_sign.tree(secret, [lms_sign.leaf_node(secret, i) for i in range(1 << height)])


def test_rfc_case_2_is_grown_and_signed_from_its_seeds():
    upper, upper_nodes = grow(rfc.CASE2_UPPER_SEED, rfc.CASE2_UPPER_IDENT, 10, 4)
    lower, lower_nodes = grow(rfc.CASE2_LOWER_SEED, rfc.CASE2_LOWER_IDENT, 5, 8)
    assert upper_nodes[1] == rfc.CASE2_UPPER_ROOT
    assert lower_nodes[1] == rfc.CASE2_LOWER_ROOT
    lower_key = lms_sign.public_key(lower, lower_nodes)
    signature = lms_sign.sign(upper, upper_nodes, rfc.CASE2_UPPER_LEAF, lower_key, rfc.CASE2_UPPER_RANDOMIZER)
    assert signature[40:72] == rfc.CASE2_UPPER_FIRST
    assert signature[-324 - 32 : -324] == rfc.CASE2_UPPER_LAST
    assert signature[-320:-288] == rfc.CASE2_UPPER_PATH_FIRST
    assert signature[-32:] == rfc.CASE2_UPPER_PATH_LAST
    assert verify(lms_sign.public_key(upper, upper_nodes), lower_key + signature) == status.OK
    signature = lms_sign.sign(
        lower, lower_nodes, rfc.CASE2_LOWER_LEAF, rfc.CASE2_MESSAGE, rfc.CASE2_LOWER_RANDOMIZER
    )
    assert signature[40:72] == rfc.CASE2_LOWER_FIRST
    assert signature[-160:-128] == rfc.CASE2_LOWER_PATH_FIRST
    assert signature[-32:] == rfc.CASE2_LOWER_PATH_LAST
    assert verify(lower_key, rfc.CASE2_MESSAGE + signature) == status.OK


@pytest.mark.parametrize("size", [24, 32])
@pytest.mark.parametrize("width", [1, 2, 4, 8])
def test_every_width_and_size_agrees_with_an_independent_implementation(width, size):
    secret, nodes = grow(bytes(range(size)), bytes(range(16)), 5, width, size)
    key = lms_sign.public_key(secret, nodes)
    message = b"a model image"
    signature = lms_sign.sign(secret, nodes, 7, message, bytes(range(32, 32 + size)))
    assert verify(key, message + signature) == status.OK
    theirs = pyhsslms.LmsPublicKey.deserialize(key)
    assert theirs.verify(message, signature)
    assert not theirs.verify(message + b"!", signature)


@pytest.mark.parametrize("size", [0, 1, 100, 1291, 1292])
def test_too_few_bytes_are_refused(size):
    assert verify(rfc.CASE1_LOWER, rfc.CASE1_SIGNATURE[:size]) == status.BAD_SIGNATURE


def test_keys_of_unknown_types_are_refused():
    for at, value in ((3, 4), (3, 10), (3, 15), (7, 0), (7, 5), (7, 9), (0, 1)):
        key = bytearray(rfc.CASE1_LOWER)
        key[at] = value
        assert lms.signature_size(bytes(key)) == 0
        assert verify(bytes(key), rfc.CASE1_MESSAGE + rfc.CASE1_SIGNATURE) == status.BAD_SIGNATURE


def test_without_sha256_the_answer_is_not_supported(monkeypatch):
    monkeypatch.setattr(lms, "sha256", None)
    assert not lms.available()
    assert verify(rfc.CASE1_LOWER, rfc.CASE1_MESSAGE + rfc.CASE1_SIGNATURE) == status.NOT_SUPPORTED
