"""How `make test` shares its work out: more workers than processors, the longest first, pages singly.

A worker often waits, for a stroke in real time or for a browser: with one worker more than processors these
stood idle a quarter of the time, so there are two more. A file stays with one worker, as its fixtures do;
what takes longest begins first, so that no worker is left with it at the end.
"""

from __future__ import annotations

import os
from functools import cache

import pytest
from xdist.scheduler import LoadFileScheduling

from tests.docs.blocks import ROOT, goes_on_from

BOARD = "tests/sim/probe/test_rp2040.py"
ON_A_BOARD = ("tests/sim/probe/test_rp2040", "tests/sim/probe/test_preloaded.py")
"""Files that start an emulated board: its firmware is compiled once for all of them, in five seconds."""
LONGEST = (
    BOARD,
    "docs/tutorial/emulated.md",
    "tests/host/learn/test_any_tissue_fit.py",
    "tests/test_demo.py",
    "tests/host/learn/test_balls.py",
    "tests/host/inversion/test_solids.py",
    "tests/host/link/test_reference.py",
    "tests/host/report/test_report.py",
    "tests/docs/test_examples.py",
    "tests/host/view/test_layout.py",
    "tests/sim/tissue/test_sweep.py",
    "tests/sim/tissue/test_solid_verification.py",
    "tests/host/inversion/test_emulated.py",
    "tests/host/inversion/test_press.py",
    "tests/sim/tissue/test_solid_derivatives.py",
    "tests/host/view/test_recorded.py",
    "tests/sim/tissue/test_solid_stroke.py",
    "docs/howto/real-strokes.md",
    "tests/sim/tissue/test_kept_balls.py",
    "tests/host/inversion/test_inversion.py",
    "tests/host/view/test_command.py",
    "tests/host/view/test_visit_map.py",
    "tests/host/view/test_access.py",
    "tests/host/inversion/test_visits.py",
    "docs/howto/your-own-regression.md",
    "tests/host/link/test_flashing.py",
    "tests/host/sources/test_owner.py",
    "tests/sim/tissue/test_inclusion.py",
    "tests/host/view/test_reference.py",
    "docs/howto/cluster.md",
)
"""By measured time (`pytest --durations=0`); files that are not here follow as they are found."""
PAGE = "tests/docs/test_code_blocks.py::test_a_page_does_what_it_says["
MOST_WORKERS = 8
MORE_THAN_PROCESSORS = 2


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """For `-n auto`."""
    return min(len(os.sched_getaffinity(0)) + MORE_THAN_PROCESSORS, MOST_WORKERS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first."""
    rank = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(scope(item.nodeid), len(LONGEST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LoadFileScheduling | None:
    """For `--dist loadfile`; any other way is xdist's own."""
    return Files(config, log) if config.getvalue("dist") == "loadfile" else None


class Files(LoadFileScheduling):
    """As `loadfile`, but each page of the documentation goes by itself, with those that go on from it."""

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)


@cache
def scope(nodeid: str) -> str:
    """What must stay with one worker: a file's tests, a page and those that go on from it, the boards'."""
    if nodeid.startswith(ON_A_BOARD):
        return BOARD
    if not nodeid.startswith(PAGE):
        return nodeid.partition("::")[0]
    at = ROOT / nodeid.removeprefix(PAGE).removesuffix("]")
    while before := goes_on_from(at):
        at = before
    return str(at.relative_to(ROOT))
