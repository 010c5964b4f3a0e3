"""The first look at a probe that was just built: what its frames say about its wiring, and what to mend."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from firmware_py import geometry
from palpate.doctor import Finding

if TYPE_CHECKING:
    from palpate.link.probe import Probe
    from palpate.wire.events import Frame

FRAMES = 100
_QUIET_COUNTS = 20.0  # .5 % of full scale, the poorest sensors that models are made for
_ZERO_COUNTS = 200  # a cell's zero may lie so far from the median of all
_NEARLY_ALL = 0.9  # of the frames
_LATE = 1.5  # of a period between two frames
_BACK_UM = 100
_MOVED_UM = 100
_BLOCKS = 10  # of the frames: what presses on cells changes slowly, noise does not
_PRESSED = 4.0  # times a cell's noise between frames, and so many counts more
_PRESSED_COUNTS = 20.0
_PRESSED_CELLS = 0.05
_TIMEOUT_S = 20.0


def first_light(probe: Probe, push_mm: float = 0.0) -> Iterator[Finding]:
    """What frames of a probe in the air say, and of one that is pushed along a ruler and back.

    Parameters
    ----------
    probe : Probe
        Connected; it streams for a while.
    push_mm : float
        How far it is pushed; 0: it lies still.
    """
    rate_Hz = probe.get_setting("frame_rate") / 1000
    before = probe.statistics()
    wanted = FRAMES if not push_mm else int(10 * rate_Hz)
    frames = _frames(probe, wanted)
    after = probe.statistics()
    late = after["frames_overrun"] - before["frames_overrun"]
    dropped = after["frames_dropped"] - before["frames_dropped"]
    yield from rate(frames, rate_Hz, late, dropped)
    if push_mm:
        yield encoder(np.array([frame.position_um for frame in frames]), push_mm)
        yield potentiometer(np.array([frame.displacement_um for frame in frames]))
    else:
        counts = np.array([frame.counts for frame in frames], float)
        touched = contact(counts, np.array([frame.position_um for frame in frames]))
        yield touched
        yield from cells(counts, in_air=touched.state == "ok")


def _frames(probe: Probe, wanted: int) -> list[Frame]:
    from palpate.wire.events import Frame

    found: list[Frame] = []
    for event in probe.stream(timeout_s=_TIMEOUT_S):
        if isinstance(event, Frame):
            found.append(event)
            if len(found) == wanted:
                break
    return found


def _named(places: np.ndarray) -> str:
    shown = [f"row {k // geometry.COLUMNS} column {k % geometry.COLUMNS}" for k in places[:4]]
    return ", ".join(shown) + (f" and {len(places) - 4} more" if len(places) > 4 else "")


def _lines(places: np.ndarray) -> str:
    """Which wire it is where a whole row or column is among the cells."""
    held = np.isin(np.arange(geometry.CELLS), places).reshape(geometry.ROWS, geometry.COLUMNS)
    lines = [f"row {k}" for k in np.flatnonzero(held.all(1))]
    lines += [f"column {k}" for k in np.flatnonzero(held.all(0))]
    return f"; all of {', '.join(lines)}: look at that wire first" if lines else ""


def contact(counts: np.ndarray, positions_um: np.ndarray) -> Finding:
    """Whether the probe lay still in the air meanwhile: else noise and zeros are not the cells' own.

    Parameters
    ----------
    counts : ndarray (frames, rows, columns)
    positions_um : ndarray (frames,)
    """
    moved_um = float(np.ptp(positions_um)) if len(positions_um) else 0.0
    pressed = False
    if len(counts) >= 2 * _BLOCKS:
        flat = counts.reshape(len(counts), -1)
        noise = np.diff(flat, axis=0).std(0) / 2**0.5
        slow = np.ptp([block.mean(0) for block in np.array_split(flat, _BLOCKS)], axis=0)
        pressed = float((slow > _PRESSED * noise + _PRESSED_COUNTS).mean()) > _PRESSED_CELLS
    if not pressed and moved_um < _MOVED_UM:
        return Finding("contact", "ok", "it lay still with nothing on its face")
    said = [f"it moved {moved_um / 1000:.1f} mm"] if moved_um >= _MOVED_UM else []
    said += ["something pressed on its face"] if pressed else []
    todo = "lay it down with its face free and ask again; noise and zeros are looked at then"
    return Finding("contact", "broken", " and ".join(said), todo)


def cells(counts: np.ndarray, in_air: bool = True) -> list[Finding]:
    """Cells at a rail and cells that never move; noise and odd zeros where nobody touches the probe.

    Parameters
    ----------
    counts : ndarray (frames, rows, columns)
    in_air : bool
        Whether nothing pressed on the cells meanwhile (`contact`).
    """
    flat = counts.reshape(len(counts), -1)
    mean, noise = np.median(flat, 0), flat.std(0)
    railed = np.flatnonzero(((flat <= 0) | (flat >= geometry.FULL_COUNT)).mean(0) > _NEARLY_ALL)
    free = np.setdiff1d(np.arange(geometry.CELLS), railed)
    found = []
    if len(railed):
        todo = "look for a short or an open wire of these cells" + _lines(railed)
        found.append(Finding("rails", "broken", f"{len(railed)} cells at a rail: {_named(railed)}", todo))
    else:
        found.append(Finding("rails", "ok", "no cell at a rail"))
    if not len(free):
        return found
    typical = float(np.median(noise[free]))
    unmoved = (flat[:, free] == mean[free]).mean(0) > _NEARLY_ALL
    dead = free[unmoved] if not unmoved.all() else np.array([], int)
    if len(dead):
        todo = "press each: one that does not answer is marked by `palpate calibrate gain`" + _lines(dead)
        found.append(Finding("dead cells", "broken", f"{len(dead)} never move: {_named(dead)}", todo))
    else:
        found.append(Finding("dead cells", "ok", "none"))
    if not in_air:
        return found
    state, todo = "ok", ""
    if typical > _QUIET_COUNTS:
        state = "broken"
        todo = "look at the reference's capacitor, the ground and the settling of the amplifiers"
    found.append(Finding("noise", state, f"{typical:.1f} counts, median of the cells", todo))
    zero = float(np.median(mean[free]))
    odd = free[np.abs(mean[free] - zero) > _ZERO_COUNTS]
    if len(odd):
        todo = "lift the probe off; if they stay, film or contact is dirty there" + _lines(odd)
        found.append(Finding("zeros", "broken", f"{len(odd)} far from {zero:.0f}: {_named(odd)}", todo))
    else:
        found.append(Finding("zeros", "ok", f"about {zero:.0f} counts"))
    return found


def rate(frames: Sequence[Frame], rate_Hz: float, late: int, dropped: int) -> list[Finding]:
    """Whether frames come as often as they are set to, and none is lost."""
    if len(frames) < 2:
        return [Finding("frames", "broken", f"{len(frames)} came", "look at the cable and the probe's log")]
    gaps_us = np.diff([frame.time_us for frame in frames])
    lost = sum(frame.lost_before for frame in frames[1:])
    got_Hz = 1e6 / float(np.mean(gaps_us))
    said = f"{got_Hz:.1f} a second of {rate_Hz:g}, {late} late, {dropped} dropped, {lost} lost on the way"
    if late or got_Hz * _LATE < rate_Hz:
        todo = f"set a rate that it keeps: palpate settings frame_rate {got_Hz * 900:.0f}"
        return [Finding("frames", "broken", said, todo)]
    if dropped or lost:
        return [Finding("frames", "broken", said, "look at the cable, or give the link fewer frames")]
    return [Finding("frames", "ok", said)]


def encoder(positions_um: np.ndarray, push_mm: float) -> Finding:
    """Direction, scale and missed edges of the wheel of a probe that was pushed that far and back."""
    away = positions_um - positions_um[0]
    far_um = float(away[np.argmax(np.abs(away))])
    back_um = float(away[-1])
    said = f"{far_um / 1000:.2f} mm of {push_mm:g} mm, {back_um / 1000:+.2f} mm when back"
    if abs(far_um) < push_mm * 100:
        return Finding("encoder", "broken", said, "the wheel is not seen: look at GP11, GP12 and its supply")
    if far_um < 0:
        return Finding("encoder", "broken", said, "it counts backwards: change A and B (GP11, GP12)")
    if abs(back_um) > _BACK_UM:
        return Finding(
            "encoder", "broken", said, "edges are missed or the wheel slips: push slower, clean it"
        )
    if abs(far_um / 1000 - push_mm) > 0.05 * push_mm:
        ratio = push_mm * 1000 / far_um
        return Finding(
            "encoder", "broken", said, f"the wheel's scale is off: multiply ENCODER_UM by {ratio:.3f}"
        )
    return Finding("encoder", "ok", said)


def potentiometer(displacements_um: np.ndarray) -> Finding:
    """Whether the way into the tissue is measured at all."""
    said = f"{displacements_um.min() / 1000:.2f} to {displacements_um.max() / 1000:.2f} mm"
    if np.ptp(displacements_um) < _BACK_UM:
        return Finding(
            "potentiometer", "broken", said, "it does not move: look at CH2 and the ends of its track"
        )
    return Finding("potentiometer", "ok", said)
