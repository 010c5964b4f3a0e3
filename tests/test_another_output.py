"""Another output is one row of one table: with it the chain estimates, sends and shows that number.

The evaluator has room for six, and six there are: here the row stands in the place of the fat's modulus.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROW = '    ("area_cm2", "cm2", True, "cross-section of the lump", 0.2, 3.15, 0.1, 6.2),\n'
TRUTH = '''
    @property
    def area_cm2(self) -> float:
        """Cross-section of the lump, cm2."""
        return 0.007854 * self.d_mm**2
'''


def copied(directory):
    """The sources under the names that are imported."""
    for folder, name in (
        ("firmware_py", "firmware_py"),
        ("host", "palpate"),
        ("sim", "palpate/sim"),
        ("model_export", "palpate/model_export"),
        ("tests/firmware_py", "tests/firmware_py"),
    ):
        shutil.copytree(ROOT / folder, directory / name)
    for path in (ROOT / "tests").glob("*.py"):
        shutil.copy2(path, directory / "tests")
    return directory


def add_the_row(home):
    """What architecture.md says: the table, and its truth where the case has no such attribute."""
    table = home / "firmware_py" / "outputs.py"
    text, n = re.subn(r'^    \("E_fat_kPa".*\n', lambda _: ROW, table.read_text(), flags=re.MULTILINE)
    assert n == 1
    table.write_text(text)
    case = home / "palpate" / "sim" / "tissue" / "case.py"
    before, after = case.read_text().split("    @property\n    def has_lump", 1)
    case.write_text(f"{before.rstrip()}\n{TRUTH}\n    @property\n    def has_lump{after}")


def run(home, module, *arguments):
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(home)},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_another_output_from_strokes_to_the_page(tmp_path):
    home = copied(tmp_path / "home")
    add_the_row(home)
    run(home, "tests.firmware_py.output_numbers")
    said = json.loads(run(home, "tests.another_output", str(tmp_path)).splitlines()[-1])
    estimate, truth = said["estimate"], said["truth"]
    assert estimate["valid"] and estimate["lump"] and estimate["in_domain"]
    assert truth["area_cm2"] == pytest.approx(0.007854 * truth["d_mm"] ** 2)
    for name in ("F_N_per_m", "t_mm", "d_mm", "h"):
        assert estimate[name]["value"] == pytest.approx(truth[name], rel=0.1), name
    area = estimate["area_cm2"]
    assert area["value"] == pytest.approx(truth["area_cm2"], rel=0.2)
    assert area["low"] < area["value"] < area["high"]
    assert any(
        line.lstrip().startswith("cross-section of the lump") and "cm2" in line for line in said["lines"]
    )
    (row,) = (row for row in said["rows"] if row["key"] == "area_cm2")
    assert (row["label"], row["unit"]) == ("Cross-section of the lump", "cm2")
    assert row["value"] == area["value"]
