"""Says so while kernels are compiled for this machine: minutes of silence look like a hang."""

from __future__ import annotations

import os
from pathlib import Path

from palpate.console import note

LINE = "compiling {what} for this machine: only the first time, a minute or two (longer on a busy machine)"


def announce(solver: bool = True, firmware: bool = False) -> None:
    """One line on standard error if what is about to run has not been compiled here yet.

    Parameters
    ----------
    solver : bool
        The finite-element kernels are about to run.
    firmware : bool
        The firmware's pipeline is about to run on the host.
    """
    wanted = []
    if solver and not _solver_is_there():
        wanted.append("the solver")
    if firmware and not _firmware_is_there():
        wanted.append("the firmware's pipeline")
    if wanted:
        note(LINE.format(what=" and ".join(wanted)))


def _solver_is_there() -> bool:
    from palpate.sim import tissue

    beside = Path(tissue.__file__).parent / "__pycache__"  # where numba puts it, unless it may not
    places = [Path(os.environ["NUMBA_CACHE_DIR"])] if "NUMBA_CACHE_DIR" in os.environ else [beside]
    if not os.access(beside.parent, os.W_OK):
        places.append(Path.home() / ".cache" / "numba")
    return any(next(place.rglob("kernels.*.nbi"), None) for place in places if place.is_dir())


def _firmware_is_there() -> bool:
    from palpate.firmware_twin.replay_core import cache_folder

    return next(cache_folder().rglob("*.nbi"), None) is not None
