"""A round trip: what a simulated sensor was made of comes back within its interval."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.characterisation import campaign
from palpate.characterisation.result import characterise
from palpate.errors import PalpateError
from palpate.importing import declaration, importer
from palpate.learn.observed import noise_named
from palpate.sim.probe.noise import LEVELS, Noise
from palpate.sim.probe.sensors import SensorModel, StrokeField
from palpate.sim.tissue import Case, simulate_forces
from palpate.sim.tissue.settings import Settings

TRUE = replace(
    LEVELS["typical"], creep=0.03, hysteresis=0.02, dead=0.0, row_gain=0.01, offset=0.004, start_mm=0.0
)
GAIN, RATE = 1.04, 50
CUFF = [[0, 0], [0.5, 0], [0.5, 18], [2, 18], [4, 0], [5, 0], [6, 12], [8, 0]]
DECLARED = """
rows = 16
columns = 26
pitch_mm = 1.5
lift = false
[pressure]
name = "kPa"
[position]
name = "x"
[displacement]
name = "z"
[time]
name = "t"
"""


@pytest.fixture(scope="module")
def plain():
    case = Case.without_lump(15.0, 0.6)
    pair = simulate_forces(case, [0.5, 0.7], Settings(start_mm=0.0))
    return StrokeField(*pair)


def probe(plain, recording):
    """The same cells in every recording; zeros, drifts and hand are of the day."""
    cells, model = SensorModel(plain, TRUE, 1), SensorModel(plain, TRUE, 100 + recording)
    model.gain = cells.gain * GAIN / cells.gain.mean()
    model.offset_kPa = cells.offset_kPa
    model.gain[3, 4], model.gain[9, 20] = 0.0, 0.0
    return model


def write(directory, name, counts, x_um, z_um, seconds):
    kPa = np.clip(np.rint(counts), 0, 4095) / 4095 * 25 - 0.5
    kPa = kPa.reshape(-1, 16, 26)
    kPa[:, 9, 20] = 7.0  # it hangs
    kPa[:, 3, 4] = -0.5
    path = directory / f"{name}.npz"
    np.savez(path, kPa=kPa, x=x_um / 1e3, z=z_um / 1e3, t=seconds)
    said = replace(declaration.read(directory / "sensor.toml"), lift=name.startswith("plain"))
    importer.import_file(path, directory / f"{name}.mcap", said)
    return f"{name}.mcap"


@pytest.fixture(scope="module")
def measured(plain, tmp_path_factory):
    """A campaign of 10 recordings in air, 4 under a cuff, 12 strokes over plain tissue."""
    home = tmp_path_factory.mktemp("campaign")
    (home / "sensor.toml").write_text(DECLARED)
    entries = []
    t = np.arange(60) / RATE
    for k in range(10):
        felt = probe(plain, k).felt(np.zeros((60, 16, 26)), np.zeros(60), 0 * t, np.linspace(0, 1, 60))
        entries.append(f'kind = "air"\ndisplacement_mm = 0.0\nfile = "{write(home, f"air{k}", *felt, t)}"')
    t = np.arange(8 * RATE) / RATE
    times, levels = np.array(CUFF, float).T
    p = np.interp(t, times + 1e-6 * np.arange(len(times)), levels)
    for k in range(4):
        whole = np.broadcast_to(p[:, None, None], (len(t), 16, 26))
        felt = probe(plain, 20 + k).felt(whole, np.zeros(len(t)), 60 * t, np.linspace(0, 1, len(t)))
        file = write(home, f"cuff{k}", *felt, t)
        entries.append(f'kind = "cuff"\nkPa = {CUFF}\nfile = "{file}"')
    for k in range(12):
        model = probe(plain, 40 + k)
        model.position_scale = 1.003
        s = model.stroke(50)
        file = write(home, f"plain{k}", s.counts, s.positions_um, s.displacements_um, s.times_us / 1e6)
        entries.append(f'kind = "plain"\ntravel_mm = 80.0\nfile = "{file}"')
    (home / "campaign.toml").write_text("".join(f"[[recording]]\n{entry}\n" for entry in entries))
    return home, characterise(campaign.read(home / "campaign.toml"))


def test_what_the_sensor_was_made_of_comes_back_within_its_interval(measured, plain):
    _, found = measured
    cells = probe(plain, 0)
    live = found.cells.live
    gain = cells.gain / cells.gain[live].mean()
    own = np.where(live, gain, np.nan)
    truth = {
        "white": TRUE.white,
        "offset": (cells.offset_kPa[live]).std(ddof=1) / 25,
        "drift": TRUE.drift,
        "common_gain": cells.gain[live].mean() - 1,
        "gain": np.nanstd(own - np.nanmean(own, axis=1)[:, None]),
        "creep": TRUE.creep,
        "hysteresis": TRUE.hysteresis,
        "force": TRUE.force,
        "position_mm": TRUE.position_mm,
        "position_scale": 0.003,
        "displacement_noise_mm": TRUE.displacement_noise_mm,
        "displacement_zero_mm": TRUE.displacement_zero_mm,
        "displacement_drift_mm": TRUE.displacement_drift_mm,
    }
    missed = {
        name: (true, found.numbers[name])
        for name, true in truth.items()
        if not found.numbers[name].low <= true <= found.numbers[name].high
    }
    assert not missed


def test_numbers_are_as_sharp_as_the_recordings_allow(measured):
    _, found = measured
    for name, relative in (("white", 0.03), ("gain", 0.15), ("creep", 0.2), ("hysteresis", 0.2)):
        q = found.numbers[name]
        assert q.high - q.low < 2 * relative * q.value, name


def test_dead_and_stuck_cells_are_named(measured):
    _, found = measured
    assert np.argwhere(found.cells.dead).tolist() == [[3, 4]]
    assert np.argwhere(found.cells.stuck).tolist() == [[9, 20]]
    assert found.noise.dead == pytest.approx(2 / 416)


def test_training_and_emulation_take_the_file(measured, palpate, tmp_path):
    home, found = measured
    status, out, _ = palpate("characterise", home / "campaign.toml", "--out", tmp_path / "sensor.toml")
    assert status == 0 and "1 dead cells, 1 stuck ones, of 416" in out
    noise = noise_named(str(tmp_path / "sensor.toml"))
    assert isinstance(noise, Noise) and noise.white == pytest.approx(found.noise.white, rel=1e-4)
    assert noise.hysteresis == pytest.approx(found.noise.hysteresis, rel=1e-4)
    from palpate.cli.emulate import check_arguments

    check_arguments("d10h08e10f10", str(tmp_path / "sensor.toml"), "tcp:127.0.0.1:0")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is a list of .*recording"),
        (
            '[[recording]]\nfile = "a.mcap"\nkind = "water"',
            "recording 1: kind is one of air, cuff, plain, not 'water'",
        ),
        ('[[recording]]\nfile = "a.mcap"\nkind = "air"\nkPa = 3', "recording 1: air knows no 'kPa'"),
        ('[[recording]]\nkind = "air"', "recording 1 names no file"),
        ('[[recording]]\nfile = "a.mcap"\nkind = "cuff"\nkPa = 12', r"a list of \[time in s, kPa\]"),
        ('[[recording]]\nfile = "a.mcap"\nkind = "cuff"\nkPa = [[0, nan]]', "a list of"),
        ('[[recording]]\nfile = "a.mcap"\nkind = "cuff"\nkPa = [[0, 5], [9, 5]]', "does not change"),
        ('[[recording]]\nfile = "a.mcap"\nkind = "air"\ndisplacement_mm = nan', "is a number, not nan"),
        ('[[recording]]\nfile = "none.mcap"\nkind = "air"', "there is no recording"),
    ],
)
def test_a_campaign_that_cannot_be(tmp_path, text, sentence):
    (tmp_path / "c.toml").write_text(text)
    with pytest.raises(PalpateError, match=sentence):
        campaign.read(tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", r"has no \[noise\]"),
        ("[noise]\nwhite = 'much'", "white is a number, not 'much'"),
        ("[noise]\nwhit = 1.0", "knows no 'whit'"),
        ("[noise]\nwhite = -1.0", "noise 'white' is -1.0"),
        ("[noise", "is not TOML"),
    ],
)
def test_a_sensor_s_file_that_cannot_be(tmp_path, text, sentence):
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(PalpateError, match=sentence):
        noise_named(str(tmp_path / "s.toml"))
