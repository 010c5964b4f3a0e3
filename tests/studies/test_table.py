"""What a study keeps of its lumps, and which of them it judges."""

import pytest

from palpate.errors import UsageError
from tests.studies.table import Asked, kept_rows


def test_the_first_lumps_can_be_left_out_but_not_all(tmp_path):
    done = []

    def row_of(k):
        done.append(k)
        return {"code": f"lump {k}"}

    rows = kept_rows(Asked(tmp_path, after=1), "rows.jsonl", 3, row_of)
    assert [row["lump"] for row in rows] == done == [1, 2]
    whole = kept_rows(Asked(tmp_path), "rows.jsonl", 3, row_of)
    assert sorted(row["lump"] for row in whole) == [0, 1, 2] and done == [1, 2, 0]
    with pytest.raises(UsageError, match="--after 3 leaves none of the 3 lumps"):
        kept_rows(Asked(tmp_path, after=3), "rows.jsonl", 3, row_of)
