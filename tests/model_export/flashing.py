"""A probe's slots, flashed as the link does it; what a flashed model may carry; what rots in a store."""

from __future__ import annotations

import numpy as np

from firmware_py import features as firmware_features
from firmware_py import forcemap, slots, status
from palpate.model_export import image_builder
from palpate.model_export.integers import compiler


def a_force_map():
    rng = np.random.default_rng(4)
    return {
        "version": forcemap.VERSION,
        "even": rng.normal(0, 0.1, (14, 9)).tolist(),
        "odd": rng.normal(0, 0.1, (8, 8)).tolist(),
        "ln_F": 4.0,
        "ln_D": 1.0,
        "rms": 0.01,
    }


def body_of(spec):
    """A model's image, counter 1, without a signature."""
    return image_builder.build(spec, compiler.compile_model(spec), None, 1)


def probe_of(store, key, **words):
    probe = slots.Slots(store, key, firmware_features.FEATURES_VERSION, firmware_features.COUNT, **words)
    probe.boot()
    return probe


def send(probe, data, piece=48):
    assert probe.begin(len(data)) == status.OK
    for at in range(0, len(data), piece):
        assert probe.write(at, data[at : at + piece]) == status.OK


def flash(probe, data):
    send(probe, data)
    for step in (probe.verify, probe.try_, probe.confirm):
        code = step()
        if code != status.OK:
            return code
    return status.OK


def model_id(data):
    return data[40:48]


def flipped(files, name, bit):
    """The files of a store, one bit of one of them another."""
    data = bytearray(files[name])
    data[bit // 8] ^= 1 << bit % 8
    return {**files, name: bytes(data)}
