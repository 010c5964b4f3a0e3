"""Decoded pressures are the true ones: by the calibration on the probe, live, played, shown and converted."""

import base64
import json
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from firmware_py import calib
from palpate.link.session import recorded
from palpate.recording import channels
from palpate.recording.convert import convert
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.recording.writer import RecordingWriter
from palpate.wire import packing as frames
from palpate.wire.events import Frame
from palpate.wire.parser import LiveParser
from palpate.wire.scale import NOMINAL, CalibrationPieces, CellScale
from tests.host.link import wires
from tests.host.probes import connect
from tests.waiting import PATIENCE_S

NOISE_COUNTS = 3.0
COUNT_KPA = 25 / 4095
DEAD = (0, 27, 200)
GAIN_KPA = 10.0
TAKEN = 200
"""Frames that a calibration takes the mean of: its own noise is a fourteenth of a frame's."""


@dataclass
class Cells:
    """A face under a pressure; its cells differ by 10 % in gain and by .2 kPa in zero, three are dead."""

    pressure_kPa: np.ndarray
    n: int = TAKEN + 60

    def __post_init__(self):
        rng = np.random.default_rng(11)
        gain = 1 + 0.1 * rng.standard_normal((16, 26))
        zero_kPa = 0.5 + 0.2 * rng.standard_normal((16, 26)).clip(-2, 2)
        still = (self.pressure_kPa * gain + zero_kPa) / COUNT_KPA
        noise = NOISE_COUNTS * rng.standard_normal((self.n, 16, 26))
        counts = np.clip(np.rint(still + noise), 0, 4095).reshape(self.n, -1)
        counts[:, DEAD] = 0
        self.packed = [frames.pack(c) for c in counts]
        self.positions_um = np.linspace(-30_000, 30_000, self.n).astype(int)
        self.displacements_um = np.full(self.n, 2500)


def bump_kPa() -> np.ndarray:
    """What a lump looks like: 4 kPa and 6 more in the middle; straight lines across where cells are dead."""
    along = 4 + 6 * np.exp(-(((np.arange(16) - 7.5) / 4) ** 2))
    return np.repeat(along[:, None], 26, axis=1)


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    """A probe calibrated in the air and under 10 kPa, then pressed: what came live, and the recording."""
    from palpate.sim.probe.emulated import EmulatedProbe

    path = tmp_path_factory.mktemp("felt") / "felt.mcap"
    with EmulatedProbe("micropython", serial=b"PRESSURE", roomy=True) as device:
        device.set_strokes([Cells(np.zeros((16, 26)))], lifted=0)
        with connect(device) as probe:
            probe.calibrate_zero(TAKEN)
            device.set_strokes([Cells(np.full((16, 26), GAIN_KPA))], lifted=0)
            done = probe.calibrate_gain(GAIN_KPA, TAKEN)
        assert done.dead_cells == len(DEAD)
        device.set_strokes([Cells(bump_kPa())])
        with recorded(device.port, path) as probe:
            assert probe.scale.calibrated
            live = []
            for event in probe.stream(timeout_s=PATIENCE_S):
                live += [event] if isinstance(event, Frame) else []
                if len(live) == 60:
                    break
    return live, path


def pressed(some: list[Frame]) -> list[Frame]:
    """Those under pressure: the probe begins a few frames in the air."""
    return [f for f in some if f.counts.max() > 500]


def assert_true(pressures_kPa: np.ndarray) -> None:
    """Within the noise: a frame's own, and that of the calibration's means.

    The gain is set in whole eighths of a count, so the mean over frames may be off by a quarter count.
    """
    error = (pressures_kPa - bump_kPa()) / COUNT_KPA
    assert abs(error.mean(axis=0)).max() < 0.75 + 4 * NOISE_COUNTS / np.sqrt(len(error))
    assert error.std() < 1.25 * NOISE_COUNTS
    assert abs(error).max() < 6 * NOISE_COUNTS


def test_live_frames_are_the_true_pressures_within_the_noise(felt):
    some = pressed(felt[0])
    assert len(some) > 40
    assert_true(np.stack([f.pressure_kPa for f in some]))
    by_nominal = np.stack([NOMINAL.kPa(f.counts) for f in some])
    assert abs(by_nominal - bump_kPa()).max() > 1.0, "the nominal scale would not have done"


def test_a_recording_plays_the_same_pressures(felt):
    live, path = felt
    with open_recording(path) as probe:
        played = {f.seq: f for f in probe.events() if isinstance(f, Frame)}
        assert probe.scale.calibrated
    for frame in live:
        assert np.array_equal(played[frame.seq].pressure_kPa, frame.pressure_kPa)


def test_other_programs_are_shown_the_same_pressures(felt):
    live, path = felt
    with path.open("rb") as stream:
        images = [
            json.loads(message.data)["data"]
            for _, channel, message in make_reader(stream).iter_messages()
            if channel.topic == channels.IMAGE
        ]
    for frame, image in zip(live, images, strict=False):
        pascal = np.frombuffer(base64.b64decode(image), "<u2").reshape(16, 26)
        assert abs(pascal - 1000 * frame.pressure_kPa.clip(0)).max() <= 0.5


@pytest.mark.parametrize("suffix", ["parquet", "csv", "h5"])
def test_a_table_holds_the_true_pressures(felt, tmp_path, suffix):
    done = convert(felt[1], tmp_path / f"felt.{suffix}")
    assert done.calibrated
    if suffix == "parquet":
        table = np.stack(pd.read_parquet(done.files[0])["pressure_kPa"]).reshape(-1, 16, 26)
    elif suffix == "csv":
        table = pd.read_csv(done.files[0]).filter(regex=r"^p_.*_kPa").to_numpy().reshape(-1, 16, 26)
    else:
        import h5py

        with h5py.File(done.files[0]) as file:
            table = file["frames/pressure_kPa"][:]
            assert file.attrs["calibrated"] == "true"
    assert_true(table[table.max(axis=(1, 2)) > 3])


def test_an_attached_calibration_will_do_where_the_wire_tells_none(felt, tmp_path):
    """As in a recording that was begun in the middle of a session."""
    _, path = felt
    blob, copy = Recording(path).attachment(channels.CALIBRATION), tmp_path / "attached.mcap"
    parser = LiveParser()
    with RecordingWriter(copy) as writer:
        writer.attach(channels.CALIBRATION, "", blob)
        for data in (wires.identified(), wires.frame(7, rng=np.random.default_rng(1))):
            for event in parser.feed(data, 1):
                writer.received(parser.raw, event, 1)
    with open_recording(copy) as probe:
        (frame,) = (e for e in probe.events() if isinstance(e, Frame))
    own = CellScale()
    assert own.load(blob)
    assert np.array_equal(frame.pressure_kPa, own.kPa(frame.counts))


def test_without_a_calibration_the_nominal_scale_is_used_and_said(tmp_path, palpate):
    path = tmp_path / "bare.mcap"
    parser = LiveParser()
    with RecordingWriter(path) as writer:
        for event in parser.feed(wires.identified() + wires.frame(3), 1):
            writer.received(parser.raw, event, 1)
    status, out, err = palpate("convert", path, tmp_path / "bare.parquet", "--json")
    assert status == 0 and json.loads(out)["calibrated"] is False
    assert "holds no calibration" in err and "nominal scale" in err
    table = pd.read_parquet(tmp_path / "bare.parquet")
    counts = 4 | 4 << 8  # wires.frame(3) is all bytes 4: every count 0x404 or 0x040
    assert table["pressure_kPa"][0][0] == pytest.approx(counts * COUNT_KPA - 0.5, abs=2e-3)


def test_pieces_may_come_twice_late_and_broken_off():
    """A scale is believed only when every byte of one reading has come."""
    old, new = calib.Calibration(), calib.Calibration()
    new.set_dead((5,))
    new.offset[0] = 700
    size, step = calib.BLOB_BYTES, 200

    def pieces(calibration):
        blob = calibration.to_bytes()
        return [(0, at, size, blob[at : at + step]) for at in range(0, size, step)]

    book = CalibrationPieces()
    assert [book.add(*piece) for piece in pieces(old)[:5]] == [None] * 5  # and then the link broke
    told = pieces(new)
    order = [told[0], told[0], *told[2:4], told[1], told[0], *told[4:]]
    scales = [book.add(*piece) for piece in order]
    assert scales[:-1] == [None] * (len(order) - 1)
    assert scales[-1]._calibration.to_bytes() == new.to_bytes()
    for foreign in ((1, 0, 9, b"ninebytes"), (0, size, size, b"x"), (0, 0, 1 << 20, b"y" * 200)):
        assert book.add(*foreign) is None
    damaged = [(0, at, size, b"\xff" * len(piece)) for _, at, _, piece in told]
    assert [book.add(*piece) for piece in damaged][-1] is None
