"""Places and depths from a second source's table, joined to frames by their times. Units: mm, s."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.csv_dialect import dialect_of
from palpate.errors import NoSuchFile
from palpate.importing.frames import FARTHEST_MM, GivenFrames, ImportFailed

Floats = NDArray[np.float64]
TIME, PLACE, DEPTH = "time_s", "position_mm", "displacement_mm"
UNIX_S = 1e8
"""Times beyond this are Unix times; others count from the recording's first frame."""
_GAP = 5.0
"""Times the usual step from row to row."""
_LEAST_GAP_S = 0.2


def join(frames: GivenFrames, began_s: float, path: Path) -> tuple[GivenFrames, list[str]]:
    """The frames with a table's places, and what is to be said of it.

    Parameters
    ----------
    frames : GivenFrames
        Their times count from the first.
    began_s : float
        Unix time of the first.
    path : Path
        CSV with the columns time_s and position_mm, and displacement_mm where there is one.

    Raises
    ------
    NoSuchFile
    ImportFailed
        A column is missing, holds what is no number, times go back, or no frame falls into them.
    """
    columns = _read(path)
    time = columns[TIME]
    time = time - began_s if time[0] > UNIX_S else time
    wanted = frames.time_s - frames.time_s[0]
    inside = (wanted >= time[0]) & (wanted <= time[-1])
    if not inside.any():
        raise ImportFailed(
            f"{path.name} has places from {time[0]:.1f} to {time[-1]:.1f} s, the recording lasts from 0 to "
            f"{wanted[-1]:.1f} s: its times are Unix times, or count from the recording's first frame"
        )
    said = []
    step = np.diff(time)
    gaps = np.flatnonzero(step > max(_GAP * float(np.median(step)), _LEAST_GAP_S))
    for k in gaps:
        within = int(((wanted > time[k]) & (wanted < time[k + 1])).sum())
        said.append(f"no places for {step[k]:.2g} s from {time[k]:.1f} s: {within} frames go straight there")
    if outside := int((~inside).sum()):
        said.append(f"{outside} frames lie before or after all places, and stay where those begin and end")
    depth = np.interp(wanted, time, columns[DEPTH]) if DEPTH in columns else frames.displacement_mm
    if DEPTH not in columns:
        said.append(f"no {DEPTH}: features of the pressure only can be used")
    return replace(frames, position_mm=np.interp(wanted, time, columns[PLACE]), displacement_mm=depth), said


def _read(path: Path) -> dict[str, Floats]:
    import pandas as pd

    try:
        sep, decimal = dialect_of(path)
        table = pd.read_csv(path, sep=sep, decimal=decimal)
    except OSError as error:
        raise NoSuchFile(f"{path} cannot be read: {(error.strerror or 'no file').lower()}") from None
    except Exception as error:  # whatever a damaged file makes of pandas
        raise ImportFailed(f"{path} is no table: {' '.join(str(error).split())[:80]}") from None
    out: dict[str, Floats] = {}
    for name in (TIME, PLACE, DEPTH):
        if name not in table and name != DEPTH:
            there = ", ".join(map(str, list(table)[:6]))
            raise ImportFailed(f"{path.name} has no column {name}; it has {there}")
        if name in table:
            values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
            most = np.inf if name == TIME else FARTHEST_MM
            if len(bad := np.flatnonzero(~(np.abs(values) <= most) | ~np.isfinite(values))):
                raise ImportFailed(f"{path.name}, row {bad[0] + 1}, {name}: no number of a hand's movement")
            out[name] = values
    if len(out[TIME]) < 2:
        raise ImportFailed(f"{path.name} holds {len(out[TIME])} places; it takes two and more")
    if len(back := np.flatnonzero(np.diff(out[TIME]) <= 0)):
        raise ImportFailed(f"{path.name}, row {back[0] + 2}, {TIME}: time does not go on")
    return out
