"""A data set is checked when it is read: what is wrong is one sentence with its row and column."""

import math

import pandas as pd
import pytest

from palpate import models
from palpate.dataset import answers, table
from palpate.dataset.columns import DataSetError
from palpate.errors import NoSuchFile, UnknownFormat, UsageError
from palpate.recording.reader import Recording

GOOD = """recording,stroke,lump,d_mm,depth_mm,E_ratio,place,visit,when
a.mcap,1,A,12,8.4,20,border,1,2026-11-21
a.mcap,2,A,12,8.4,20,border,1,2026-11-21
b.mcap,1,B,8,6,,fat,1,
b.mcap,2,B,8,6,,fat,2,
"""


def read(tmp_path, text=GOOD):
    (tmp_path / "set.csv").write_text(text)
    return table.read(tmp_path / "set.csv")


def test_a_good_table_is_read_and_what_follows_is_worked_out(tmp_path):
    data = read(tmp_path)
    assert (len(data), data.lumps) == (4, 2)
    first, third = data.table.iloc[0], data.table.iloc[2]
    assert first["h"] == pytest.approx(0.7) and first["t_mm"] == pytest.approx(14.4)
    assert math.isnan(third["E_ratio"]) and math.isnan(third["t_mm"]), "what is not said is not made up"
    assert first["recording"] == tmp_path / "a.mcap"
    assert any("t_mm" in remark for remark in data.remarks)


def test_semicolons_and_decimal_commas_say_the_same(tmp_path):
    """ "Expected 1 fields in line 2, saw 4": a spreadsheet of a country that writes 8,4."""
    said = read(tmp_path)
    (tmp_path / "theirs.csv").write_text(GOOD.replace(",", ";").replace("8.4", "8,4"))
    theirs = table.read(tmp_path / "theirs.csv")
    pd.testing.assert_frame_equal(theirs.table, said.table)


def test_csv_and_parquet_say_the_same(tmp_path):
    data = read(tmp_path)
    table.write(pd.read_csv(tmp_path / "set.csv"), tmp_path / "set.parquet")
    pd.testing.assert_frame_equal(table.read(tmp_path / "set.parquet").table, data.table)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "a.mcap,2,A",
            "a.mcap,1,A",
            "row 3, column stroke: stroke 1 of a.mcap is listed twice; it is in row 2",
        ),
        ("b.mcap,1,B,8", "b.mcap,1,B,nan", "row 4, column d_mm: nan is not a number"),
        ("b.mcap,1,B,8", "b.mcap,1,B,eight", "row 4, column d_mm: 'eight' is not a number"),
        (
            "b.mcap,1,B,8",
            "b.mcap,1,B,.008",
            "row 4, column d_mm: 0.008 is not within 0.5 to 100; is it in m. d_mm",
        ),
        ("b.mcap,2,B,8", "b.mcap,2,B,", "row 5, column d_mm: lump B has nothing here and 8 in row 4"),
        ("b.mcap,2,B,8", "b.mcap,2,B,9", "row 5, column d_mm: lump B has 9 here and 8 in row 4"),
        ("b.mcap,2,B,8", "b.mcap,,B,8", "row 5, column stroke: it is empty"),
        ("b.mcap,2,B,8", "b.mcap,2,,8", "row 5, column lump: it is empty"),
        (",fat,1", ",liver,1", "row 4, column place: 'liver' is not one of border, fat, gland"),
        ("a.mcap,2", "a\0.mcap,2", r"row 3, column recording: 'a\\x00.mcap' is no file's name"),
        ("2026-11-21", "the 21st", "row 2, column when: 'the 21st' is not a date"),
        ("lump,", "lumps,", "has no column lump: which lump"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path, old, new, sentence):
    assert old in GOOD
    with pytest.raises(DataSetError, match=sentence):
        read(tmp_path, GOOD.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("recording,stroke,lump,d_mm,d_mm\na.mcap,1,A,12,13\n", "row 1, column d_mm: it is there twice"),
        ("recording,stroke,lump,d_mm\na.mcap,1,A,12,7,7\n", "Expected 4 fields in line 2, saw 6"),
    ],
)
def test_a_heading_that_does_not_fit_the_rows_is_refused(tmp_path, text, sentence):
    """Once the second of two columns was dropped, and values too many shifted all the others."""
    with pytest.raises(DataSetError, match=sentence):
        read(tmp_path, text)


def test_lengths_in_cm_blame_the_column_that_was_written(tmp_path):
    """Once it was t, which follows from d and depth and stood in no file."""
    data = read(tmp_path, "recording,stroke,lump,d_mm,depth_mm,place\na.mcap,1,A,1.2,0.8,border\n")
    with pytest.raises(DataSetError, match=r"row 2, column d_mm: 1.2 is outside .* is it in cm"):
        answers.refuse_outside(data, models.load())


def test_h_and_depth_must_agree(tmp_path):
    text = "recording,stroke,lump,d_mm,depth_mm,h\na.mcap,1,A,10,8,0.5\n"
    with pytest.raises(DataSetError, match="row 2, column depth_mm: 8 contradicts h, which makes it 5"):
        read(tmp_path, text)


def test_kPa_need_the_fat_s(tmp_path):
    text = "recording,stroke,lump,d_mm,E_kPa,fat_kPa\na.mcap,1,A,10,100,\n"
    with pytest.raises(DataSetError, match="row 2, column E_kPa: it needs fat_kPa"):
        read(tmp_path, text)
    data = read(tmp_path, text.replace("100,", "100,10"))
    assert data.table["E_ratio"][0] == 10


def test_a_lump_with_one_stroke_is_remarked(tmp_path):
    data = read(tmp_path, "".join(GOOD.splitlines(keepends=True)[:-1]))
    assert any(r.startswith("row 4, column lump: B has one stroke only") for r in data.remarks)


@pytest.mark.parametrize(
    ("d", "sentence"),
    [
        (1.2, "row 2, column d_mm: 1.2 is outside the model's range of 5 to 20; is it in cm. d_mm is in mm"),
        (25, "row 2, column d_mm: 25 is outside the model's range of 5 to 20; leave such lumps out with"),
    ],
)
def test_a_truth_outside_the_model_s_range_is_refused(tmp_path, d, sentence):
    """Diameters in cm are plausible numbers: 1.2 mm is no lump, and 12 mm is one."""
    data = read(tmp_path, f"recording,stroke,lump,d_mm\na.mcap,1,A,{d}\n")
    with pytest.raises(DataSetError, match=sentence):
        answers.refuse_outside(data, models.load())
    assert not answers.check_ranges(data, models.load()).any()


def test_files_that_are_no_tables(tmp_path):
    with pytest.raises(NoSuchFile, match="no data set"):
        table.read(tmp_path / "none.csv")
    with pytest.raises(UnknownFormat, match=r"\.csv, \.parquet"):
        table.read(tmp_path / "set.xlsx")
    (tmp_path / "set.parquet").write_bytes(b"no table")
    with pytest.raises(DataSetError, match="cannot be read as a table"):
        table.read(tmp_path / "set.parquet")


@pytest.mark.parametrize(
    ("column", "value"), [("d_mm", [12.0, 13.0]), ("when", [1, 2]), ("d_mm", {"a": 1}), ("d_mm", "twelve")]
)
def test_a_list_in_a_place_of_parquet_is_named(tmp_path, column, value):
    """It was "the truth value of an array ... is ambiguous"."""
    row = {"recording": "a.mcap", "stroke": 1, "lump": "A", "d_mm": 12.0, column: value}
    pd.DataFrame([row]).to_parquet(tmp_path / "set.parquet")
    with pytest.raises(DataSetError, match=f"row 2, column {column}: .* is not a "):
        table.read(tmp_path / "set.parquet")


@pytest.mark.parametrize("index", [["x", "y"], [1e18, math.nan], [(1, 2), (3, 4)]])
def test_parquets_own_names_of_rows_count_for_nothing(tmp_path, index):
    """Rows named by words, NaN or pairs ended as "unexpected TypeError"."""
    rows = pd.DataFrame({"recording": "a.mcap", "stroke": [1, 2], "lump": "A", "d_mm": [12.0, pd.NA]})
    rows.index = pd.MultiIndex.from_tuples(index) if isinstance(index[0], tuple) else pd.Index(index)
    rows.to_parquet(tmp_path / "set.parquet")
    with pytest.raises(DataSetError, match="row 3, column d_mm: the row holds no truth"):
        table.read(tmp_path / "set.parquet")


def test_what_never_ends_is_not_read(tmp_path):
    """A table, or a recording of one, that was a link to /dev/zero took 4 GB and all there was."""
    for name in ("set.csv", "set.parquet"):
        (tmp_path / name).symlink_to("/dev/zero")
        with pytest.raises(UsageError, match="is a device or a pipe"):
            table.read(tmp_path / name)
    with pytest.raises(UsageError, match="is a device or a pipe"):
        Recording("/dev/zero")


def test_a_table_of_very_many_columns_is_refused_before_it_is_read(tmp_path):
    """200,000 took more than a minute and a half, each name being sought among all before it."""
    many = ",".join(f"x{k}" for k in range(20_000))
    with pytest.raises(DataSetError, match="it has 20000 columns, and 10000 are read at most"):
        read(tmp_path, f"{many}\n{many}\n")


def test_rows_are_counted_as_an_editor_counts_them(tmp_path):
    """Blank lines were skipped, and the row that was named lay above the one that was meant."""
    text = "recording,stroke,lump,d_mm,h\n\na.mcap,1,A,10,0.8\n\n,,,,\na.mcap,2,A,eight,0.8\n"
    with pytest.raises(DataSetError, match="row 6, column d_mm: 'eight' is not a number"):
        read(tmp_path, text)


@pytest.mark.parametrize("text", ["", "\n\n", ",,\n"])
def test_a_table_of_nothing_says_so(text, tmp_path):
    with pytest.raises(DataSetError, match="cannot be read as a table"):
        read(tmp_path, text)
