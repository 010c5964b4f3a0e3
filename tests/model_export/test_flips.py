"""Every single-bit flip of a signed image is refused, by the verifier that the probe runs."""

from __future__ import annotations

import pytest

from firmware_py import signature, status
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from tests.campaigns import counted


def count_accepted_flips(data: bytes, key: bytes, every: int = 1) -> int:
    """Of every bit, or every so-many-th."""
    image = bytearray(data)

    def read(at, n):
        return bytes(image[at : at + n])

    assert signature.verify(key, read, len(image)) == status.OK
    accepted = 0
    for number in range(0, 8 * len(image), every):
        at, bit = divmod(number, 8)
        image[at] ^= 1 << bit
        accepted += signature.verify(key, read, len(image)) == status.OK
        image[at] ^= 1 << bit
    assert bytes(image) == data
    return accepted


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.long)])
def test_bits_of_a_thesis_image(signed, public_key, every):
    """Every fifth: each byte has its turn, and each place in a byte."""
    assert count_accepted_flips(signed[1], public_key, every) == 0
    counted(f"{-(-8 * len(signed[1]) // every)} flips")


def test_every_bit_of_the_public_key(signed, public_key):
    for at in range(len(public_key)):
        for bit in range(8):
            other = bytearray(public_key)
            other[at] ^= 1 << bit
            data = signed[1]
            code = signature.verify(bytes(other), lambda a, n, d=data: d[a : a + n], len(data))
            assert code == status.BAD_SIGNATURE


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_every_bit_of_a_field_image_with_the_default_key(field, tmp_path):
    key = keys.generate(tmp_path / "key")  # a real one: some 6 minutes
    data, _ = export(field, tmp_path / "key")
    assert count_accepted_flips(data, key) == 0
    counted(f"{8 * len(data)} flips")


@pytest.mark.parametrize("cut", [1, 4, 32, 1000])
def test_a_shortened_or_lengthened_image(signed, public_key, cut):
    for data in (signed[1][:-cut], signed[1][cut:], signed[1] + bytes(cut), bytes(cut) + signed[1]):
        code = signature.verify(public_key, lambda a, n, d=data: d[a : a + n], len(data))
        assert code == status.BAD_SIGNATURE


def test_two_halves_of_two_good_images(signed, public_key):
    mixed = signed[1][:1000] + signed[2][1000:]
    assert signature.verify(public_key, lambda a, n: mixed[a : a + n], len(mixed)) == status.BAD_SIGNATURE
