"""What was departed from is told by odds and misfit; the limit is what strokes as they are exceed in 5 %."""

from palpate.inversion.departures import FRICTION, TWO_LUMPS, UNDULATING
from tests.studies.departed import AS_IT_IS, FARTHER, WORLDS, judged


def told(odds, chi2=0.9):
    return {"problem": "", "odds": odds, "chi2": chi2, "fits": chi2 < 1.3 and odds.get("anywhere", 0) > 0.1}


def test_what_is_told_rightly_is_counted_beside_what_is_only_seen():
    rows = [
        {
            "code": "",
            AS_IT_IS: told({"anywhere": 1.0 - 0.01 * k, FRICTION: 0.01 * k}),
            UNDULATING: told({"anywhere": 0.01, UNDULATING: 0.99}),
            FRICTION: told({"anywhere": 1.0}, chi2=2.0),
            TWO_LUMPS: {"problem": "no equilibrium"} if k else told({"anywhere": 1.0}),
            FARTHER: told({TWO_LUMPS: 1.0}) | {"sizes": [1.1, 0.95 + 0.1 * k]},
        }
        for k in range(4)
    ]
    (table,) = judged(rows)
    assert [row[0] for row in table.rows] == list(WORLDS)
    assert [row[1:] for row in table.rows] == [
        ["4", "0 %", "0 %", "0 %", "0 %", ""],
        ["4", "100 %", "0 %", "100 %", "100 %", ""],
        ["4", "100 %", "100 %", "0 %", "100 %", ""],
        ["1", "0 %", "0 %", "0 %", "0 %", ""],
        ["4", "100 %", "0 %", "100 %", "100 %", "3 of 4"],
    ]
