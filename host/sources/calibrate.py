"""The steps of `palpate calibrate` for an array that keeps nothing itself."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from palpate.errors import PortError, UsageError
from palpate.link.schemes import Address
from palpate.sources.bridge import reading_of
from palpate.sources.kept import CURVED, drift, place

STILL = 0.02
"""In the air the mean reading stands still to this share of full scale; noise of cells averages out."""


def take(address: Address, source: Any, pressure_kPa: float | None, frames: int) -> dict[str, Any]:
    """Zero in the air (no pressure told), or a point under a uniform pressure; kept at once.

    Returns
    -------
    dict: frames, noise (raw), dead_cells, points, misfit_kPa, file; `said` is the sentence

    Raises
    ------
    UsageError
        A zero is asked for while something moves on the array; nothing is kept.
    """
    line = source.line(address)
    with reading_of(line) as reading:
        kept, path = reading.kept, place(address)
        images = reading.take(frames)
    if pressure_kPa is None:
        moved = float(images.mean(axis=(1, 2)).std())
        if moved > STILL * line.source.FULL_RAW:
            raise UsageError(
                f"this is no zero: the mean reading wanders by {moved:.2g} of {line.source.FULL_RAW:g}; "
                "hold the array in the air and ask again"
            )
        kept.zero(images)
    else:
        kept.add(pressure_kPa, images)
    kept.save(path)
    noise = float(np.median(images.std(axis=0)))
    points, dead = [point["kPa"] for point in kept.points], len(kept.dead)
    said = f"{len(images)} frames, noise {noise:.2g} of {line.source.FULL_RAW:g}; "
    if not points:
        said += "now gain, under a known pressure"
    else:
        said += f"{dead} dead cells; " + ", ".join(f"{p:g}" for p in points) + " kPa known"
        more = CURVED - len(points)
        said += (
            f", a curve a cell from {more} more"
            if more > 0
            else f", curves miss by {kept.misfit_kPa():.2g} kPa"
        )
    return {
        "frames": len(images),
        "noise": noise,
        "dead_cells": dead,
        "points_kPa": points,
        "misfit_kPa": kept.misfit_kPa() if points else None,
        "file": str(path),
        "said": f"{said} ({path})",
    }


def watch(address: Address, source: Any, seconds: float) -> dict[str, Any]:
    """The zero's drift in the air.

    Returns
    -------
    dict: Pa_per_minute, worst_Pa_per_minute, seconds, recalibrate_after_min; `said` is the sentence

    Raises
    ------
    PortError
        The array has fallen silent.
    """
    with reading_of(source.line(address)) as reading:
        times_s, cells = [], []
        dead = reading.kept.dead
        until = heard = time.monotonic()
        until += seconds
        while (now := time.monotonic()) < until:
            for raw, time_us, _ in reading.next(0.1):
                times_s.append(time_us / 1e6)
                cells.append(reading.kPa(raw).ravel())
                heard = now
            if now - heard > 3.0:
                raise PortError(address.text, f"{address.text} has fallen silent; is it still there?")
        kPa = np.array(cells)
        kPa[:, dead] = np.nan
        found = drift(np.array(times_s), kPa)
    after = found.recalibrate_after_min()
    return {
        "Pa_per_minute": found.Pa_per_minute,
        "worst_Pa_per_minute": found.worst_Pa_per_minute,
        "seconds": found.seconds,
        "recalibrate_after_min": after,
        "said": f"{found.Pa_per_minute:+.1f} Pa a minute over {found.seconds:.0f} s, the worst cell "
        f"{found.worst_Pa_per_minute:.0f}; calibrate zero again after {after:.0f} min (100 Pa)",
    }


def clear(address: Address) -> dict[str, Any]:
    """Forget what is kept of an array; its port is not opened."""
    path = place(address)
    there = path.exists()
    path.unlink(missing_ok=True)
    return {"file": str(path), "said": f"{path} is removed" if there else f"there was no {path}"}
