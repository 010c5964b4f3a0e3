"""A recording in other programs' hands: tables in every format, topics that Foxglove reads."""

import json
import resource

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from palpate.errors import PalpateError
from palpate.recording import channels
from palpate.recording.convert import convert
from palpate.wire.events import Frame
from tests.host.link import wires
from tests.host.processes import start_palpate
from tests.host.recording.recorded import record
from tests.waiting import PATIENCE_S


@pytest.mark.parametrize("sealed", [True, False])
def test_other_programs_read_the_decoded_topics(tmp_path, sealed):
    path = tmp_path / "foxglove.mcap"
    rng = np.random.default_rng(1)
    data = wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(5)) + wires.estimate(1)
    events = record(path, data, sealed)
    topics = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is None:
                continue
            assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
            known = json.loads(schema.data)["properties"]
            words = json.loads(message.data)
            assert set(known) <= set(words)
            topics.setdefault(channel.topic, []).append((message, words))
    frames = [e for e in events if isinstance(e, Frame)]
    message, image = topics[channels.IMAGE][3]
    import base64

    pascal = np.frombuffer(base64.b64decode(image["data"]), "<u2").reshape(16, 26)
    assert np.abs(pascal - 1000 * frames[3].pressure_kPa.clip(0)).max() <= 0.5
    assert (image["width"], image["height"], image["encoding"]) == (26, 16, "mono16")
    assert message.publish_time == 1000 * frames[3].time_us
    assert message.log_time == frames[3].host_ns
    _, motion = topics[channels.MOTION][3]
    assert motion["position_mm"] == pytest.approx(frames[3].position_mm)
    _, estimate = topics[channels.ESTIMATE][0]
    assert estimate["d_mm"] == {"value": 7.0, "low": 8.0, "high": 9.0}


def test_all_formats_hold_the_same_table(tmp_path):
    rng = np.random.default_rng(2)
    data = wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(1203) if k != 7)
    path = tmp_path / "table.mcap"
    frames = [e for e in record(path, data + wires.estimate(1) + wires.estimate(2)) if isinstance(e, Frame)]
    for name in ("t.csv", "t.parquet", "t.h5"):
        done = convert(path, tmp_path / name)
        assert (done.frames, done.estimates, done.lost) == (1202, 2, 1)
        assert all(file.exists() for file in done.files)
    truth = np.stack([f.pressure_kPa for f in frames])
    csv = pd.read_csv(tmp_path / "t.csv")
    parquet = pd.read_parquet(tmp_path / "t.parquet")
    import h5py

    with h5py.File(tmp_path / "t.h5") as file:
        tables = {
            "csv": csv.filter(like="_kPa").to_numpy().reshape(-1, 16, 26),
            "parquet": np.stack(parquet["pressure_kPa"]).reshape(-1, 16, 26),
            "h5": file["frames/pressure_kPa"][:],
        }
        assert file["estimates/d_mm_high"][:].tolist() == [9.0, 9.0]
        assert (file["frames/seq"][:] == csv["seq"]).all()
    for table in tables.values():
        np.testing.assert_allclose(table, truth, rtol=1e-4, atol=1e-4)
    assert (parquet["time_us"] == [f.time_us for f in frames]).all()
    assert parquet["lost_before"].sum() == csv["lost_before"].sum() == 1
    beside = pd.read_csv(tmp_path / "t.estimates.csv")
    assert beside["d_mm"].tolist() == [7.0, 7.0] and beside["hardness"].tolist() == ["hard", "hard"]


def test_a_bound_that_is_not_there_is_nan_in_hdf5(tmp_path):
    """Over a hard lump E has no upper end: h5py refused the column as objects."""
    import h5py

    record(
        tmp_path / "hard.mcap",
        wires.identified() + wires.frame(0) + wires.estimate(1, E_inv23=(0.02, 0, 0.1)),
    )
    convert(tmp_path / "hard.mcap", tmp_path / "hard.h5")
    with h5py.File(tmp_path / "hard.h5") as file:
        assert np.isnan(file["estimates/E_ratio_high"][0]) and file["estimates/E_ratio_low"][0] > 30


def test_a_table_that_is_there_is_not_written_over(tmp_path):
    record(tmp_path / "a.mcap", wires.identified() + wires.frame(0))
    (tmp_path / "a.estimates.csv").write_text("somebody's")
    with pytest.raises(PalpateError, match=r"a\.estimates\.csv exists already; .* --overwrite"):
        convert(tmp_path / "a.mcap", tmp_path / "a.csv")
    assert (tmp_path / "a.estimates.csv").read_text() == "somebody's" and not (tmp_path / "a.csv").exists()
    assert convert(tmp_path / "a.mcap", tmp_path / "a.csv", overwrite=True).frames == 1


@pytest.mark.parametrize("suffix", ["parquet", "csv", "h5"])
def test_a_disk_that_fills_while_converting_is_said_and_leaves_nothing(tmp_path, suffix):
    path, out = tmp_path / "long.mcap", tmp_path / "out" / f"long.{suffix}"
    out.parent.mkdir()
    rng = np.random.default_rng(4)
    record(path, wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(2100)))
    small = (300_000, 300_000)
    with start_palpate(
        "convert", path, out, prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, small)
    ) as run:
        _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 1
    assert "Traceback" not in err
    assert "the disk is full" in err.strip().splitlines()[-1]
    assert list(out.parent.iterdir()) == []
