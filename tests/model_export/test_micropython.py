"""The same integers on real MicroPython (the WASM port), and no allocation in an evaluation."""

from __future__ import annotations

import json

import numpy as np
import pytest

from firmware_py import features as firmware_features
from firmware_py import model_image
from palpate.model_export import image_builder
from palpate.model_export.integers import compiler, sampling
from tests.micropython import run_micropython
from tests.model_export.test_two_stages import Q24, alike_on_micropython


def rows(spec, n):
    """Full feature rows: half of them vectors of the domain, half anything at all."""
    out = []
    for k, vector in enumerate(sampling.in_domain(spec, n, seed=5)):
        row = [(k * 7919 * (i + 3) * 104729) % (2**30) - 2**29 for i in range(firmware_features.COUNT)]
        if k % 2:
            for ident, value in zip(compiler.feature_ids(spec.features), vector):
                row[ident] = round(value * 2**24)
        out.append([max(min(v, 2**29 - 1), 1 - 2**29) for v in row])
    return out


@pytest.mark.parametrize("kind", ["thesis", "field"])
def test_1000_vectors_give_the_same_integers_and_allocate_nothing(kind, request):
    spec, tables = request.getfixturevalue(kind), request.getfixturevalue(f"{kind}_tables")
    body = image_builder.build(spec, tables, None, 1)
    here = alike_on_micropython(body, np.array(rows(spec, 1000)) / Q24)
    assert len({tuple(row) for row in here}) > 500


FLASH = """
import json, os
from firmware_py import features, slh_dsa, slots, store

key = open('public.key', 'rb').read()
slh_dsa.SETS[200] = 2, 4, 8, 4  # tests.model_export.small_key
os.mkdir('/probe')
place = store.FileStore('/probe')

def boot():
    s = slots.Slots(place, key, features.FEATURES_VERSION, features.COUNT)
    return s, s.boot()

said = [boot()[1]]
for name in ('one', 'two', 'one', 'back', 'torn'):
    data = open(name, 'rb').read()
    s, _ = boot()
    code = s.begin(len(data))
    for at in range(0, len(data), 48):
        code = code or s.write(at, data[at:at + 48])
    code = code or s.verify() or s.try_() or s.confirm()
    s, booted = boot()
    said.append([code, booted, s.live_id().hex() if hasattr(bytes, 'hex') else None])
print(json.dumps(said))
"""


def test_flashing_verifying_and_rolling_back_on_micropython(signed, public_key):
    torn = bytearray(signed[3])
    torn[900] ^= 4
    files = {
        "one": signed[1],
        "two": signed[2],
        "back": signed[-1],
        "torn": bytes(torn),
        "public.key": public_key,
    }
    ids = {name: data[40:48].hex() for name, data in files.items()}
    said = json.loads(run_micropython(FLASH, files))
    assert said == [
        -7,
        [0, 0, ids["one"]],
        [0, 0, ids["two"]],
        [-17, 0, ids["two"]],
        [0, 0, ids["back"]],
        [-14, 0, ids["back"]],
    ]
    assert ids["one"] != ids["back"] and model_image.PROBE == b"16x26 at 1500 um"
