"""Frames of anybody's sensor become recordings that replay, view and data sets read."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate import models
from palpate.dataset.strokes import read_strokes
from palpate.errors import PalpateError
from palpate.importing import declaration, importer, resample
from palpate.importing.frames import ImportFailed
from palpate.link import emulator_model as emulator
from palpate.stroke.read import load_strokes
from palpate.stroke.replay import replay
from palpate.wire.packing import unpack
from tests.host.probes import FRAMES

DECLARED = """
rows = 16
columns = 26
pitch_mm = 1.5
[pressure]
name = "p_{row}_{column}"
unit = "Pa"
[position]
name = "x"
unit = "cm"
[displacement]
name = "z"
[time]
name = "t"
unit = "ms"
[stroke]
name = "stroke"
"""


@pytest.fixture(scope="module")
def felt(bench_frames):
    """Two strokes as a laboratory would have them: pressures in Pa, places in cm."""
    return bench_frames


@pytest.fixture(scope="session")
def bench_frames(bench):
    kPa = [s.counts / 4095 * 25 - 0.5 for s in bench[0]]
    return [
        {
            "pressure": 1e3 * p.reshape(-1, 16, 26),
            "x": s.positions_um / 1e4,
            "z": s.displacements_um / 1e3,
            "t": s.times_us / 1e3,
        }
        for p, s in zip(kPa, bench[0])
    ]


def table(felt):
    parts = []
    for k, stroke in enumerate(felt):
        cells = {f"p_{r}_{c}": stroke["pressure"][:, r, c] for r in range(16) for c in range(26)}
        parts.append(pd.DataFrame({**cells, **{n: stroke[n] for n in "xzt"}, "stroke": k}))
    return pd.concat(parts)


def declared(tmp_path, text=DECLARED):
    path = tmp_path / "sensor.toml"
    path.write_text(text)
    return declaration.read(path)


def test_an_imported_csv_replays_bit_for_bit_and_is_the_same_stroke(felt, bench, tmp_path, palpate):
    table(felt).to_csv(tmp_path / "a.csv", index=False)
    done = importer.import_file(
        tmp_path / "a.csv", tmp_path / "a.mcap", declared(tmp_path), emulator.image(models.TOLD)
    )
    assert (done.strokes, done.frames, done.missing) == (2, 2 * FRAMES, ())
    assert [s.identical for s in replay(tmp_path / "a.mcap")] == [True, True]
    said = palpate("replay", tmp_path / "a.mcap")
    fat = [x for x in "\n".join(said[1:]).splitlines() if "stiffness of the fat" in x]
    assert fat and all("assumed" in line for line in fat), said
    assert [s.value("d_mm") is not None for s in load_strokes(tmp_path / "a.mcap")] == [True, True]
    strokes = read_strokes(tmp_path / "a.mcap")
    own = bench[0][0]
    assert strokes[1].packed == own.packed[-len(strokes[1].packed) :], "counts come back as they were"
    assert np.array_equal(strokes[1].positions_um, own.positions_um[-len(strokes[1].packed) :])


def test_a_table_of_another_country_is_the_same_recording(felt, tmp_path):
    """Semicolons, decimal commas and cells counted from 1: "no column p_0_0 ... 0 are there"."""
    said = declared(tmp_path)
    table(felt).to_csv(tmp_path / "ours.csv", index=False)
    names = {f"p_{r}_{c}": f"p_{r + 1}_{c + 1}" for r in range(16) for c in range(26)}
    table(felt).rename(columns=names).to_csv(tmp_path / "theirs.csv", index=False, sep=";", decimal=",")
    for name in ("ours", "theirs"):
        importer.import_file(tmp_path / f"{name}.csv", tmp_path / f"{name}.mcap", said)
    ours, theirs = (read_strokes(tmp_path / f"{name}.mcap") for name in ("ours", "theirs"))
    assert [s.packed for s in theirs.values()] == [s.packed for s in ours.values()]
    assert [s.positions_um.tolist() for s in theirs.values()] == [
        s.positions_um.tolist() for s in ours.values()
    ]


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".h5"])
def test_every_format_gives_the_same_recording(felt, tmp_path, suffix):
    whole = {n: np.concatenate([s[n] for s in felt]) for n in ("pressure", "x", "z", "t")}
    whole["stroke"] = np.repeat([0, 1], FRAMES)
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, **whole)
    elif suffix == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, values in whole.items():
                file[name] = values
    else:
        pd.DataFrame(
            {n: list(v.reshape(2 * FRAMES, -1)) if v.ndim > 1 else v for n, v in whole.items()}
        ).to_parquet(path)
    said = declared(tmp_path, DECLARED.replace('"p_{row}_{column}"', '"pressure"'))
    importer.import_file(path, tmp_path / "a.mcap", said)
    table(felt).to_csv(tmp_path / "b.csv", index=False)
    importer.import_file(tmp_path / "b.csv", tmp_path / "b.mcap", declared(tmp_path))
    a, b = (read_strokes(tmp_path / f"{name}.mcap") for name in "ab")
    assert [s.packed for s in a.values()] == [s.packed for s in b.values()]


def test_what_is_missing_is_said_and_written_down(felt, tmp_path):
    table(felt[:1]).drop(columns=["x", "z", "t"]).to_csv(tmp_path / "a.csv", index=False)
    text = DECLARED.split("[position]")[0].replace("[pressure]", "frames_per_s = 37.5\n[pressure]")
    said = declared(tmp_path, text + "[position]\nconstant_mm_per_s = 60.0\n")
    done = importer.import_file(tmp_path / "a.csv", tmp_path / "a.mcap", said)
    assert set(done.missing) == {"displacement", "position", "time"}
    assert any("no displacement" in remark for remark in done.remarks)
    assert any("steady 60 mm/s" in remark for remark in done.remarks)
    stroke = read_strokes(tmp_path / "a.mcap")[1]
    assert stroke.missing == {"displacement", "position", "time"}
    assert np.ptp(stroke.positions_um) == pytest.approx(60e3 * np.ptp(stroke.times_us) / 1e6, rel=0.01)


def test_a_recording_by_another_array_is_imported_too(felt, tmp_path):
    table(felt).to_csv(tmp_path / "a.csv", index=False)
    importer.import_file(tmp_path / "a.csv", tmp_path / "a.mcap", declared(tmp_path))
    done = importer.import_file(tmp_path / "a.mcap", tmp_path / "b.mcap", declared(tmp_path))
    assert done.strokes == 2


@given(rows=st.integers(4, 20), columns=st.integers(4, 30), pitch=st.floats(0.8, 4), seed=st.integers(0, 99))
def test_resampling_loses_no_force_that_lies_on_both_faces(rows, columns, pitch, seed):
    """A bump in the middle, whatever the array: its force is the same on both."""
    x, y = (pitch * (np.arange(n) - (n - 1) / 2) for n in (rows, columns))
    at = np.random.default_rng(seed).uniform(-1, 1, 2)
    bump = np.exp(-((x[:, None] - at[0]) ** 2 + (y - at[1]) ** 2) / 8)[None]
    bump[:, [0, -1]] = bump[:, :, [0, -1]] = 0.0
    inside = (np.abs(x)[:, None] + pitch / 2 <= 12) & (np.abs(y) + pitch / 2 <= 19.5)
    bump = np.where(inside, bump, 0.0)
    there = resample.onto_this_array(bump, (pitch, pitch))
    assert there.min() >= 0
    assert there.sum() * 1.5**2 == pytest.approx(bump.sum() * pitch**2, rel=1e-9, abs=1e-9)


def test_dead_cells_are_filled_from_their_neighbours(felt, tmp_path):
    frames = table(felt[:1])
    frames["p_4_7"] = 0.0
    frames["p_5_7"] = np.nan
    frames.to_csv(tmp_path / "a.csv", index=False)
    said = declared(tmp_path, "dead = [[4, 7]]\n" + DECLARED)
    importer.import_file(tmp_path / "a.csv", tmp_path / "a.mcap", said)
    packed = read_strokes(tmp_path / "a.mcap")[1].packed[20]
    cells = unpack(packed).reshape(16, 26).astype(float)
    assert cells[4, 7] == pytest.approx(cells[4, 6], rel=0.15)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda t: t.drop(columns="p_3_4"),
            r"no column p_3_4: 16 x 26 cells need 416 columns, and 415 are there",
        ),
        (
            lambda t: t.assign(p_2_2=np.where(np.arange(len(t)) == 5, np.nan, 1)),
            r"frame 5, cell 2, 2: not a number",
        ),
        (lambda t: t.assign(x=["oops"] * len(t)), r"frame 0, x: 'oops' is not a number"),
        (lambda t: t.assign(t=0.0), r"frame 1, t: time does not go on"),
        (lambda t: t.assign(p_2_2=1e300), r"frame 0: 1e\+297 kPa is none of a stroke"),
        (lambda t: t.drop(columns="z"), r"has no 'z'"),
        (lambda t: t[:1], "a stroke takes more"),
    ],
)
def test_a_file_that_is_not_what_it_is_declared_to_be(felt, tmp_path, change, sentence):
    change(table(felt[:1])).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ImportFailed, match=sentence):
        importer.import_file(tmp_path / "a.csv", tmp_path / "a.mcap", declared(tmp_path))
    assert not (tmp_path / "a.mcap").exists()


def test_a_file_that_was_written_by_half(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.zeros(50))
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ImportFailed, match=r"a.npz cannot be read: File is not a zip file"):
        importer.import_file(tmp_path / "a.npz", tmp_path / "a.mcap", declared(tmp_path))


def test_a_name_with_other_braces_is_a_name(tmp_path):
    said = declared(tmp_path, DECLARED.replace("p_{row}_{column}", "{p}_{row}_{column}"))
    assert said.cell_names()[:2] == ["{p}_0_0", "{p}_0_1"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rows = 16", "rows = 1", "rows is a whole number from 2 on"),
        ("pitch_mm = 1.5", "pitch_mm = 1500", "pitch_mm is a number from"),
        ('unit = "cm"', 'unit = "inch"', "position.unit is one of um, mm, cm, m, not 'inch'"),
        ('unit = "Pa"', 'unit = "counts"', "counts need pressure.kPa_per_unit"),
        ("[stroke]", "[strokes]", "there is no 'strokes'"),
        ('[time]\nname = "t"\nunit = "ms"', "", "say when the frames were taken"),
        ("rows = 16", "rows = 16\ndead = [[16, 0]]", "is not a .row, column. of 16 x 26"),
        ("rows = 16", "rows =", "is not TOML"),
    ],
)
def test_a_declaration_that_cannot_be(tmp_path, old, new, sentence):
    assert old in DECLARED
    with pytest.raises(PalpateError, match=sentence):
        declared(tmp_path, DECLARED.replace(old, new))


def test_the_command_says_what_it_made(felt, tmp_path, palpate):
    table(felt).to_csv(tmp_path / "a.csv", index=False)
    (tmp_path / "sensor.toml").write_text(DECLARED)
    asked = ("import", tmp_path / "a.csv", "--as", tmp_path / "sensor.toml", "--out", tmp_path / "out")
    status, out, _ = palpate(*asked)
    assert status == 0 and "2 strokes, 80 frames" in out
    status, _, err = palpate(*asked)
    assert status == 1 and "exists already" in err
    assert palpate("replay", tmp_path / "out" / "a.mcap")[0] == 0


ONE_ARRAY = DECLARED.replace('"p_{row}_{column}"', '"pressure"')


def arrays(felt):
    return {name: felt[0][name] for name in ("pressure", "x", "z", "t")} | {"stroke": np.zeros(FRAMES, int)}


def rotten(path, felt):
    np.savez(path, **arrays(felt))
    raw = bytearray(path.read_bytes())
    raw[1500] ^= 0xFF
    path.write_bytes(raw)


def parquet(path, felt, change):
    columns = {n: list(v.reshape(FRAMES, -1)) if v.ndim > 1 else v for n, v in arrays(felt).items()}
    columns["pressure"] = [row.tolist() for row in columns["pressure"]]
    change(columns)
    pd.DataFrame(columns).to_parquet(path)


def hollow(path, felt):
    """80 MB of zeros in 80 kB."""
    np.savez_compressed(path, **(arrays(felt) | {"pressure": np.zeros((24_000, 16, 26))}))


HOSTILE = {
    "a rotten member": ("a.npz", rotten, "cannot be read"),
    "an array of objects": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"x": np.array([{}] * FRAMES)})),
        "x: it cannot be read",
    ),
    "pressures of objects": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"pressure": np.array([[1, 2], None], object)})),
        "pressure: it cannot be read",
    ),
    "no frames": (
        "a.npz",
        lambda path, felt: np.savez(path, **{name: values[:0] for name, values in arrays(felt).items()}),
        "0 frames",
    ),
    "words for pressures": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"pressure": np.full((FRAMES, 416), "high")})),
        "is not a number",
    ),
    "an empty row": (
        "a.parquet",
        lambda path, felt: parquet(path, felt, lambda c: c["pressure"].__setitem__(3, [])),
        "frame 3, pressure: 0 numbers",
    ),
    "a ragged row": (
        "a.parquet",
        lambda path, felt: parquet(path, felt, lambda c: c["pressure"][7].pop()),
        "frame 7, pressure: 415 numbers",
    ),
    "no row": (
        "a.parquet",
        lambda path, felt: parquet(path, felt, lambda c: c["pressure"].__setitem__(2, None)),
        "frame 2, pressure",
    ),
    "a time of 1e18": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"t": np.r_[felt[0]["t"][:-1], 1e18]})),
        "look at the unit",
    ),
    "places of 1e12 mm": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"x": felt[0]["x"] + 1e11})),
        "frame 0, x: 1e+12 mm",
    ),
    "complex pressures": (
        "a.npz",
        lambda path, felt: np.savez(path, **(arrays(felt) | {"x": felt[0]["x"] * 1j})),
        "x: complex numbers are none of a sensor",
    ),
    "80 MB in a thousandth": ("a.npz", hollow, "over 100 times its size"),
    "no archive": ("a.npz", lambda path, _: path.write_bytes(b"PK\3\4" + bytes(400)), "cannot be read"),
    "a table cut short": (
        "a.parquet",
        lambda path, felt: (parquet(path, felt, len), path.write_bytes(path.read_bytes()[:-900])),
        "cannot be read",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_a_sentence_and_leaves_nothing(felt, tmp_path, kind):
    """Most ended as "unexpected", one after a minute, one with half a recording."""
    name, make, says = HOSTILE[kind]
    make(tmp_path / name, felt)
    said = declared(tmp_path, ONE_ARRAY)
    with pytest.raises(PalpateError, match=re.escape(says)):
        importer.import_file(tmp_path / name, tmp_path / "out.mcap", said)
    assert not list(tmp_path.glob("*out*"))


@pytest.mark.parametrize("kind", ["hollow", "elsewhere", "virtual", "words", "nothing", "good"])
def test_a_hostile_hdf5_file_is_refused_too(felt, tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(bytes(416 * 8 * FRAMES))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in arrays(felt).items():
            if name != "pressure" or kind == "good":
                file[name] = values
        shape = (FRAMES, 416)
        if kind == "hollow":  # nothing is written of it, and it has a terabyte
            file.create_dataset("pressure", (1 << 28, 416), "f8", chunks=(1, 416))
        elif kind == "elsewhere":
            file.create_dataset(
                "pressure", shape, "f8", external=[(str(tmp_path / "secret"), 0, 416 * 8 * FRAMES)]
            )
        elif kind == "virtual":
            layout = h5py.VirtualLayout(shape, "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", shape)
            file.create_virtual_dataset("pressure", layout)
        elif kind == "nothing":
            file["pressure"] = np.ones(shape)
            del file["x"]
            file["x"] = h5py.Empty("f8")
        elif kind == "words":
            file["pressure"] = ["high"] * FRAMES
    said = declared(tmp_path, ONE_ARRAY)
    if kind == "good":
        assert importer.import_file(tmp_path / "a.h5", tmp_path / "out.mcap", said).frames
        return
    with pytest.raises(PalpateError):
        importer.import_file(tmp_path / "a.h5", tmp_path / "out.mcap", said)
    assert not list(tmp_path.glob("*out*"))


@pytest.mark.parametrize(
    ("rate", "says"), [("1e-9", "s from the first frame is none of a stroke"), ("1e8", "is 10000 at most")]
)
def test_frames_that_take_days_or_no_time_are_refused(felt, tmp_path, rate, says):
    """ "unexpected error: argument out of range", and frames of one microsecond."""
    np.savez(tmp_path / "a.npz", **arrays(felt))
    text = f"frames_per_s = {rate}\n{ONE_ARRAY.partition('[time]')[0]}"
    with pytest.raises(PalpateError, match=says):
        importer.import_file(tmp_path / "a.npz", tmp_path / "out.mcap", declared(tmp_path, text))


def test_an_import_that_fails_leaves_the_recording_that_was_there(felt, tmp_path, monkeypatch):
    np.savez(tmp_path / "a.npz", **arrays(felt))
    (tmp_path / "out.mcap").write_bytes(b"last week's")
    said = declared(tmp_path, ONE_ARRAY)
    monkeypatch.setattr(importer, "_play", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        importer.import_file(tmp_path / "a.npz", tmp_path / "out.mcap", said, overwrite=True)
    assert (tmp_path / "out.mcap").read_bytes() == b"last week's"
    assert [path.name for path in tmp_path.glob("*.mcap")] == ["out.mcap"]


@pytest.mark.parametrize("text", ["unit = []", "unit = {}", "name = [1]", "kPa_per_unit = nan", "zero = inf"])
def test_a_declaration_of_the_wrong_kinds_is_a_sentence(tmp_path, text):
    with pytest.raises(PalpateError):
        declared(tmp_path, DECLARED.replace('unit = "Pa"', text, 1).replace('name = "p_', 'name = "q_'))
