"""The force map: learned, packed without loss, evaluated by the firmware, refused where it is not one."""

import json
from array import array

import numpy as np
import pytest

from firmware_py import forcemap
from palpate.model_export.integers import force_map


def firmware_move(blob, image, depth, u):
    """What the firmware makes of an image in kPa and a depth in mm."""
    unit = 6105e-6 / 32
    rows = array("i", [round(v / unit) for v in image])
    moved = forcemap.move(
        forcemap.load(blob), rows, 0, round(depth * 16000), round(u * 2**24), array("i", bytes(192))
    )
    return np.array(rows) * unit, moved / 16000


def test_it_moves_an_image_to_another_force(all_strokes, fitted_map, map_blob):
    """From the lower force to the higher: what is left is a small part of the way."""
    for low, high in all_strokes:
        for k in (0, 9, -1):
            u = float(np.log(high.images_kPa[k].sum() / low.images_kPa[k].sum()))
            image, depth = firmware_move(map_blob, low.images_kPa[k], low.displacement_mm[k], u)
            way = np.linalg.norm(high.images_kPa[k] - low.images_kPa[k])
            assert np.linalg.norm(image - high.images_kPa[k]) < 0.15 * way
            assert depth == pytest.approx(high.displacement_mm[k], rel=0.03)


@pytest.mark.parametrize("u", [-0.3, -0.1, -0.01, 0.01, 0.1, 0.3])
def test_the_firmware_moves_as_float64_does(all_strokes, fitted_map, map_blob, u):
    for low, _ in all_strokes[:5]:
        image, depth = low.images_kPa[::6], low.displacement_mm[::6]
        true, true_depth = fitted_map.move(image, depth, np.full(len(image), u))
        for k in range(len(image)):
            got, got_depth = firmware_move(map_blob, image[k], depth[k], u)
            assert got == pytest.approx(true[k], abs=3e-3 * abs(u) * image[k].max() + 4e-4)
            assert got_depth == pytest.approx(true_depth[k], rel=2e-4)


def test_a_mirrored_image_moves_to_the_mirrored_image(all_strokes, map_blob):
    low, _ = all_strokes[0]
    image, depth = low.images_kPa[12], low.displacement_mm[12]
    one, _ = firmware_move(map_blob, image, depth, 0.1)
    other, _ = firmware_move(map_blob, image[::-1], depth, 0.1)
    assert other[::-1] == pytest.approx(one, abs=1e-3)


def test_packing_loses_nothing(fitted_map, map_blob):
    loaded = forcemap.load(map_blob)
    unpacked = np.array(loaded[forcemap.HEAD :]) / 2.0 ** loaded[0]
    assert np.array_equal(unpacked, np.concatenate([fitted_map.even.ravel(), fitted_map.odd.ravel()]))
    assert len(map_blob) == forcemap.BLOB_BYTES
    travelled = json.loads(json.dumps(fitted_map.as_dict()))
    assert force_map.blob(travelled) == map_blob


def test_what_is_no_force_map_is_refused(fitted_map, map_blob):
    assert forcemap.load(map_blob[:-1]) is None
    for at, value in ((0, 0), (1, 99), (2, 40), (3, 1), (7, 100)):
        blob = bytearray(map_blob)
        blob[at] = value
        assert forcemap.load(bytes(blob)) is None
    good = fitted_map.as_dict()
    for bad in ({"version": 1}, {"even": [[1.0]]}, {"odd": "x"}, {"ln_F": float("nan")}):
        with pytest.raises(ValueError, match=r"force map|numbers"):
            force_map.ForceMap.from_dict(good | bad)
    with pytest.raises(ValueError, match="cannot be packed"):
        force_map.blob(good | {"even": (100 * np.array(good["even"])).tolist()})


def test_it_is_not_fitted_to_too_little_or_the_wrong_way_round(all_strokes):
    low, high = all_strokes[0]
    few = (low.images_kPa, low.displacement_mm, high.images_kPa, high.displacement_mm)
    with pytest.raises(ValueError, match="too few"):
        force_map.fit(*few)
    many = [np.concatenate([v] * 10) for v in few]
    with pytest.raises(ValueError, match="pressed harder"):
        force_map.fit(many[2], many[3], many[0], many[1])
