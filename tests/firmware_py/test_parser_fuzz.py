"""Coverage-guided fuzzing of the parsers and of a whole probe behind them."""

import re
import subprocess
import sys

import pytest

from tests.campaigns import counted


@pytest.mark.long
def test_four_minutes_of_fuzzing_find_nothing(tmp_path):
    """No exception, no input over 20 s, no more than a gigabyte."""
    words = [
        "-max_total_time=240",
        "-timeout=20",
        "-rss_limit_mb=1000",
        "-max_len=600",
        f"-artifact_prefix={tmp_path}/",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "tests.firmware_py.fuzz_parsers", *words, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    runs = int(re.search(r"Done (\d+) runs", done.stderr)[1])
    counted(f"{runs} inputs in 240 s, each to both parsers and to a whole probe")
    assert runs > 1000
