"""Images whose numbers make no sense are refused by name, by the same function on the host and on the probe.

An output whose ends were exchanged kept `unpack.middle` going for ever: unsigned it hung `palpate flash` and
`replay`, signed the probe.
"""

from __future__ import annotations

import contextlib
import json
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import features as firmware_features
from firmware_py import model_image as fw
from firmware_py import slots, status
from palpate.model_export import image_builder
from palpate.model_export.errors import ImageError
from palpate.model_export.integers import compiler
from palpate.sim.probe.flash_sim import FlashSim
from tests.micropython import run_micropython
from tests.model_export import small_key

INTS = (-(1 << 31), -(1 << 30), -(1 << 29) - 1, -1, 0, 1, 1 << 29, (1 << 30) - 1, 1 << 30, (1 << 31) - 1)
BYTES = (0, 1, 0x7F, 0x80, 0xFF)
INT_SECTIONS = (fw.NUMBERS, fw.FEATURES, fw.ROWS, fw.OUTPUTS, fw.LIMITS)


@pytest.fixture(scope="module")
def body(thesis, thesis_tables):
    return image_builder.build(thesis, thesis_tables, None, 1)


@pytest.fixture(scope="module")
def places(body):
    return fw.Header(lambda at, n: body[at : at + n], len(body)).places


def opened(body):
    """Status of an image as the probe opens it; it must end, and raise nothing but what it is guarded for."""

    def read(at, n):
        return body[at : at + n]

    code, model = fw.load(read, len(body), firmware_features.FEATURES_VERSION, firmware_features.COUNT)
    if code == status.OK:
        try:
            fw.self_test(model, read, firmware_features.COUNT)
        except OverflowError:
            code = status.OVERFLOW
    return code


def extremes(body, places):
    """Every whole number of every table at its extremes, every byte of the head and of small sections."""
    for tag in INT_SECTIONS:
        at, n = places[tag]
        whole = {fw.NUMBERS: 16, fw.ROWS: n // 5 * 4}.get(tag, n)
        for k in range(at, at + whole - 3, 4):
            for value in INTS:
                yield k, struct.pack("<i", value)
        for k in range(at + whole, at + n):
            for value in BYTES:
                yield k, bytes((value,))
    for k in range(fw.HEAD_SIZE):
        for value in BYTES:
            yield k, bytes((value,))
    for tag in (fw.IDS, fw.STEPS, fw.INFO, fw.SELF_TEST):
        at, n = places[tag]
        for k in range(at, at + n):
            for value in BYTES:
                yield k, bytes((value,))


@pytest.mark.parametrize(
    ("section", "first"), [(fw.OUTPUTS, 0), (fw.OUTPUTS, 4), (fw.FEATURES, 0), (fw.FEATURES, 3)]
)
def test_exchanged_ends_are_refused_and_hang_nothing(body, places, section, first):
    at = places[section][0] + 4 * first
    low, high = struct.unpack_from("<2i", body, at)
    assert low < high
    swapped = body[:at] + struct.pack("<2i", high, low) + body[at + 8 :]
    assert opened(swapped) == status.BAD_MODEL
    with pytest.raises(ImageError, match="no model can have"):
        image_builder.inspect(swapped)
    key, sign = small_key.signer()
    probe = slots.Slots(FlashSim(), key, firmware_features.FEATURES_VERSION, firmware_features.COUNT)
    probe.boot()
    data = sign(swapped)
    probe.begin(len(data))
    probe.write(0, data)
    assert probe.verify() == status.BAD_MODEL


@pytest.mark.parametrize(
    ("section", "at", "form", "value", "wanted"),
    [
        (fw.FEATURES, 0, "<i", 1 << 30, status.BAD_MODEL),  # a clip beyond 32
        (fw.FEATURES, 8, "<i", 1 << 29, status.BAD_MODEL),  # a centre outside it
        (fw.ROWS, -1, "<b", 127, status.BAD_MODEL),  # a shift of 127 bits
        (fw.ROWS, -1, "<b", -100, status.BAD_MODEL),
        (fw.LIMITS, 0, "<i", -1, status.MISSING_FEATURE),
        (fw.NUMBERS, 16, "<H", 1001, status.BAD_MODEL),  # a level above 1
        (fw.NUMBERS, 23, "<B", 29, status.BAD_MODEL),  # bits of a feature
        (fw.INFO, 0, "<B", 27, status.BAD_MODEL),  # an escape code in the names
    ],
)
def test_each_kind_of_nonsense_has_a_name(body, places, section, at, form, value, wanted):
    start, n = places[section]
    k = start + (at if at >= 0 else n + at)
    assert opened(body[:k] + struct.pack(form, value) + body[k + struct.calcsize(form) :]) == wanted


@pytest.mark.parametrize(
    ("at", "value", "wanted"),
    [(12, 1 << 30, status.BAD_MODEL), (16, 5, status.BAD_MODEL), (20, 1, status.BAD_LENGTH),
     (20, 1 << 16, status.BAD_MODEL), (5, 2, status.BAD_MODEL), (7, 2, status.BAD_MODEL),
     (102, 1, status.BAD_LENGTH)],
)  # fmt: skip
def test_so_has_each_of_the_heads(body, at, value, wanted):
    """Counters of 2^30 and more, a rollback that is none, checks that are not there, unknown kinds."""
    data = bytearray(body)
    data[at : at + (4 if value > 255 else 1)] = value.to_bytes(4 if value > 255 else 1, "little")
    assert opened(bytes(data)) == wanted


def test_a_section_of_odd_length_is_refused(body, places):
    for tag in range(1, fw.LAST + 1):
        data = bytearray(body)
        at = 78 + 2 * tag
        n = data[at] | data[at + 1] << 8
        for other in (n - 1, n + 1, n - 3):
            if other >= 0 and (other + 3 & -4) == (n + 3 & -4):
                data[at : at + 2] = other.to_bytes(2, "little")
                assert opened(bytes(data)) != status.OK or tag in (fw.INFO, fw.SELF_TEST)


def test_force_map_junk_is_refused_not_dropped(field):
    junk = image_builder.build(field, compiler.compile_model(field), b"F" * 392, 1)
    assert opened(junk) == status.BAD_MODEL


def test_every_number_at_its_extremes_ends_with_a_status(body, places, capsys):
    found: dict[int, int] = {}
    for at, raw in extremes(body, places):
        code = opened(body[:at] + raw + body[at + len(raw) :])
        found[code] = found.get(code, 0) + 1
    with capsys.disabled():
        print(f"\n{sum(found.values())} images with a number at its extreme: status and how many {found}")
    assert set(found) <= set(status.TEXT) and sum(found.values()) > 2500


@settings(max_examples=200, deadline=None)
@given(changes=st.lists(st.tuples(st.integers(0, 3000), st.binary(min_size=1, max_size=8)), max_size=6))
def test_any_damage_gives_a_model_or_one_sentence(body, places, changes):
    """The features' names are read by the host alone: the probe goes by their numbers."""
    data = bytearray(body)
    at, n = places[fw.INFO]
    names = slice(at, at + n)
    for at, raw in changes:
        at %= len(body) - 8
        data[at : at + len(raw)] = raw
    code = opened(bytes(data))
    with contextlib.suppress(ImageError):
        image_builder.inspect(bytes(data))
        return
    assert code != status.OK or data[names] != body[names]
    with pytest.raises(ImageError, match=r"^[^\n]+\Z"):
        image_builder.inspect(bytes(data))


def test_micropython_gives_the_same_status_to_each(body, places):
    cases = list(extremes(body, places))[::7]
    said = run_micropython(
        """
import json
from firmware_py import features, model_image, status
body = open("body", "rb").read()
out = []
for at, raw in json.loads(open("cases", "rb").read()):
    data = bytearray(body)
    for i in range(len(raw)):
        data[at + i] = raw[i]
    data = bytes(data)
    read = lambda at, n: data[at:at + n]
    code, model = model_image.load(read, len(data), features.FEATURES_VERSION, features.COUNT)
    if code == 0:
        try:
            model_image.self_test(model, read, features.COUNT)
        except OverflowError:
            code = status.OVERFLOW
    out.append(code)
print(json.dumps(out))
""",
        {"body": body, "cases": json.dumps([(at, list(raw)) for at, raw in cases]).encode()},
    )
    ours = [opened(body[:at] + raw + body[at + len(raw) :]) for at, raw in cases]
    wrong = [
        (case, a, b)
        for case, a, b in zip(cases, json.loads(said), ours)
        # an int beyond 32 bits is an OverflowError at the array's door in one and wraps in the other
        if a != b and status.OVERFLOW not in (a, b)
    ]
    assert not wrong
