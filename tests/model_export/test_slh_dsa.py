"""SLH-DSA: our signer, the probe's verifier and an implementation by others agree."""

from __future__ import annotations

import hashlib

import pytest
import slhdsa

from firmware_py import signature, slh_dsa, status
from palpate.model_export.signing import slh_kernels, slh_sign
from tests.micropython import run_micropython
from tests.model_export import small_key

SECRET = slh_sign.Secret(*(bytes(range(k, k + 16)) for k in (0, 16, 32)))


@pytest.fixture(scope="module")
def public():
    return slh_sign.public_key(SECRET)


@pytest.fixture(scope="module")
def signed(public):
    message = bytes(range(256)) * 3
    return message + slh_sign.sign(SECRET, public, message, signature.MODEL)


def verify(key, data, *context):
    return signature.verify(key, lambda at, n: data[at : at + n], len(data), *context)


def test_a_store_that_gives_less_than_it_said_gives_no_signature(public, signed):
    body = 768
    parts = (100, body, body + 5, body + 16, body + 1000, body + 3000, len(signed) - 800, len(signed) - 1)
    for end in parts:
        cut = signed[:end]
        code = signature.verify(public, lambda at, n, cut=cut: cut[at : at + n], len(signed))
        assert code == status.BAD_SIGNATURE, end


def test_a_signature_of_nothing_and_a_key_of_another_kind_are_refused(public, signed):
    of_nothing = slh_sign.sign(SECRET, public, b"", signature.MODEL)
    assert verify(public, of_nothing) == status.BAD_SIGNATURE
    for stranger in (b"", bytes(36), b"XYZ" + public[3:], public[:3] + b"\x09" + public[4:], public[:-1]):
        assert slh_dsa.signature_size(stranger) == 0
        assert verify(stranger, signed) == status.BAD_SIGNATURE


def test_the_constants_of_sha_256_are_worked_out_rightly():
    import numpy as np

    block = np.zeros(64, np.int64)
    block[:3], block[3], block[63] = list(b"abc"), 128, 24
    out = np.empty(8, np.int64)
    slh_kernels.compress(slh_kernels.START, block, np.empty(64, np.int64), out)
    assert b"".join(int(w).to_bytes(4, "big") for w in out) == hashlib.sha256(b"abc").digest()


def test_another_implementation_makes_the_same_key_and_signature(public, signed):
    """PyPI's slh-dsa, written from FIPS 205 by others."""
    seeds = (SECRET.seed, SECRET.prf, SECRET.public_seed, public[20:])
    theirs = slhdsa.SecretKey(seeds, slhdsa.sha2_128s)
    assert theirs.pubkey.digest() == public[4:]
    message, end = signed[:768], signed[768:]
    assert len(end) == signature.size(public) == 7856
    assert theirs.pubkey.verify_pure(message, end, signature.MODEL)
    assert not theirs.pubkey.verify_pure(message + b"!", end, signature.MODEL)


@pytest.mark.long
def test_another_implementation_signs_to_the_same_bytes(public, signed):
    seeds = (SECRET.seed, SECRET.prf, SECRET.public_seed, public[20:])
    theirs = slhdsa.SecretKey(seeds, slhdsa.sha2_128s)
    assert theirs.sign_pure(signed[:768], False, signature.MODEL) == signed[768:]


def test_the_probes_verifier_takes_it_for_this_purpose_only(public, signed):
    assert verify(public, signed) == status.OK
    assert verify(public, signed, signature.SUCCESSOR) == status.BAD_SIGNATURE


def test_micropython_agrees_and_keeps_its_numbers_small(public, signed):
    broken = bytearray(signed)
    broken[2000] ^= 1
    said = run_micropython(
        "from firmware_py import signature\n"
        "key = open('key', 'rb').read()\n"
        "for name in ('good', 'broken'):\n"
        "    data = open(name, 'rb').read()\n"
        "    print(signature.verify(key, lambda at, n: data[at:at + n], len(data)))\n",
        {"key": public, "good": signed, "broken": bytes(broken)},
    )
    assert said.split() == [str(status.OK), str(status.BAD_SIGNATURE)]


@pytest.mark.parametrize("numbers", [(2, 4, 8, 4), (3, 3, 5, 6), (4, 9, 3, 12), (1, 5, 9, 3)])
def test_sets_of_any_shape_agree(numbers, monkeypatch):
    """Trees' addresses of 0 to 27 bits, digits that do not end at a byte: what one set alone would hide."""
    monkeypatch.setitem(slh_dsa.SETS, 201, numbers)
    secret = slh_sign.Secret(SECRET.seed, SECRET.prf, SECRET.public_seed, 201)
    public = slh_sign.public_key(secret)
    for k in range(3):
        message = bytes((k,)) * (1 + 100 * k)
        data = message + slh_sign.sign(secret, public, message, signature.MODEL)
        assert verify(public, data) == status.OK
        assert verify(public, b"?" + data[1:]) == status.BAD_SIGNATURE


def test_the_small_set_is_no_part_of_what_is_installed():
    import subprocess
    import sys

    said = subprocess.run(
        [sys.executable, "-c", "from firmware_py import slh_dsa; print(list(slh_dsa.SETS))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert said.stdout.strip() == "[1]" and small_key.SMALL in slh_dsa.SETS


@pytest.mark.parametrize("at", range(16))
def test_a_signer_is_believed_for_all_of_his_key_and_not_for_half_of_it(at):
    """With the root compared on 8 of its 16 bytes half the work forges, and five files of tests passed."""
    secret = small_key.secret(5)
    public = bytearray(slh_sign.public_key(secret))
    signed = b"m" + slh_sign.sign(secret, bytes(public), b"m", signature.MODEL)
    assert verify(bytes(public), signed) == status.OK
    public[-16 + at] ^= 1  # a key whose root is another, in one byte: he signs as if it were his
    signed = b"m" + slh_sign.sign(secret, bytes(public), b"m", signature.MODEL)
    assert verify(bytes(public), signed) == status.BAD_SIGNATURE
