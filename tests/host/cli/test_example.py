"""`palpate example`: the examples can be had wherever Palpate is installed."""

import json
from pathlib import Path

from tests.docs.test_examples import EXAMPLES


def test_every_example_can_be_had_without_the_repository(palpate, tmp_path):
    """`palpate example` lists them all, and copies what each needs beside it; it writes over nothing."""
    code, out, _ = palpate("example", "--json")
    names = json.loads(out)["examples"]
    assert code == 0 and all(names.values())
    assert set(names) == {p.stem for p in EXAMPLES.glob("*.py")} | {"first_hour", "c", "foreign_world"}
    for name in names:
        code, out, _ = palpate("example", name, "--to", tmp_path, "--json")
        assert code == 0 and all(Path(path).exists() for path in json.loads(out)["files"])
    assert (tmp_path / "foreign_world.npz").stat().st_size > 100_000
    code, _, err = palpate("example", "c", "--to", tmp_path)
    assert code == 2 and "exists already" in err
