"""For all tests: hypothesis draws the same examples each time and has no clock.

Promises of the reference board need MicroPython's own port, which this project does not contain: where it is
not to be had they are skipped, and the last lines say so.
"""

import os
import sys

import pytest
from hypothesis import HealthCheck, settings

# Hundreds of commands start here: without kept byte code each compiles SciPy, pandas and Numba anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Workers whose BLAS each takes all processors wait for each other: a fit of balls took thirty times as long.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

settings.register_profile(
    "palpate", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("palpate")

pytest_plugins = ["tests.workers"]


@pytest.fixture(scope="session")
def real_key_dir(tmp_path_factory):
    """A key as users have it: two seconds a signature."""
    from palpate.model_export.signing import keys

    directory = tmp_path_factory.mktemp("key") / "key"
    keys.generate(directory)
    return directory


@pytest.fixture(scope="session")
def public_key(real_key_dir):
    """Of that key. A folder with a `key_dir` of its own needs its own `public_key`, too: this one is kept."""
    return (real_key_dir / "public.key").read_bytes()


NOT_TRIED = "no UF2 of MicroPython"


def pytest_runtest_setup(item):
    """Tests marked `board` run where MicroPython's port for the Pico is found."""
    if item.get_closest_marker("board"):
        from tests.sim.probe.board_bench import uf2

        if uf2() is None:
            pytest.skip(NOT_TRIED)


def pytest_terminal_summary(terminalreporter):
    """Say what was not tried."""
    skipped = terminalreporter.stats.get("skipped", [])
    missing = [report for report in skipped if NOT_TRIED in str(report.longrepr)]
    if missing:
        terminalreporter.section("not tried")
        promises = (
            "1 promise of the reference board was"
            if len(missing) == 1
            else (f"{len(missing)} promises of the reference board were")
        )
        terminalreporter.write_line(
            f"{promises} not tried, for want of MicroPython for the "
            "Pico: download RPI_PICO-*-v1.24.1.uf2 from micropython.org, and run "
            "PALPATE_RP2_UF2=/path/to/it make test"
        )
