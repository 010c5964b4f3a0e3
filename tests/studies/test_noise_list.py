"""The list of what noise may lack: each item is tried, and what is refused, flagged or wrong is counted."""

import numpy as np
import pytest

from palpate.sim.probe.noise import LEVELS
from tests.studies import noise_list


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Two lumps and a plain tissue, simulated."""
    return noise_list.prepare(tmp_path_factory.mktemp("list"), 2, workers=1)


def test_each_item_is_tried_on_every_lump_and_shares_are_of_all_strokes(few):
    typical = LEVELS["typical"]
    items = (
        noise_list.Item("as trained", typical, plain=True),
        noise_list.Item("cells hang", typical.with_(stuck=0.02), plain=True),
        noise_list.Item("16 frames", typical, frames=16),
        noise_list.Item("ends 15 mm past the lump", typical.with_(start_mm=0.0), past_mm=15),
    )
    lumps, plain = few
    assert len(lumps) == 2 and len(plain) == 1
    rows = noise_list.table_of(lumps, plain, items)
    assert [row["item"] for row in rows] == [item.words for item in items]
    for row in rows:
        assert row["strokes"] == 2 * noise_list.DRAWS
        answered = row["n"] / row["strokes"]
        assert answered + row["not_found"] + sum(row["refused"].values()) == pytest.approx(1)
        if answered:
            parts = row["right"] + row["wrong"] + row["flagged"] * answered
            assert parts == pytest.approx(answered)
    whole, hanging, sparse, short = rows
    assert whole["hanging"] == whole["mended"] == 0
    assert hanging["hanging"] > 0 and hanging["mended"] <= hanging["hanging"]
    assert sparse["n"] == 0 and sum(sparse["refused"].values()) == 1
    assert short["n"] < whole["n"]
    assert whole["plain_lump"] == 0 and "plain_lump" not in sparse
    for _, heads, cells in noise_list.text_of(rows):
        assert cells and all(len(line) == len(heads) for line in cells)


@pytest.mark.parametrize("rise", [-0.2, 0.3])
def test_a_ramp_begins_and_ends_as_far_from_the_mean(few, rise):
    lumps, _ = few
    field = noise_list.StrokeField(*lumps[0].strokes)
    hand = noise_list.Hand(field, LEVELS["none"], 1)
    hand.rise = rise
    first, middle, last = hand.force_at(np.array([-40.0, 0.0, 40.0]))
    assert middle == pytest.approx(field.middle_N_per_m)
    assert (first / middle, last / middle) == pytest.approx((1 - rise, 1 + rise))
