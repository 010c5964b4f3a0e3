"""`palpate emulate`: a probe without hardware."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from host.cli.output import json_option, note, print_json
from host.errors import NoSuchFile, PalpateError, UsageError

if TYPE_CHECKING:
    from firmware_py.calib import Calibration
    from sim.probe.sensors import FrameStream

PUBLIC_KEY = "public.key"
POLL_S = 0.2


@click.command("emulate")
@click.argument("code")
@click.option("--runtime", default="micropython", show_default=True,
              help="What carries the firmware: micropython (the real one, as WASM) or cpython.")  # fmt: skip
@click.option("--listen", default="pty", show_default=True, help="pty, or tcp:HOST:PORT (port 0: any).")
@click.option("--key", type=click.Path(path_type=Path), help="Directory of the key whose models it accepts.")
@click.option("--store", type=click.Path(path_type=Path, file_okay=False),
              help="Directory that is its flash memory; kept.")  # fmt: skip
@click.option(
    "--noise", default="typical", show_default=True, help="none, good, typical or poor sensors and hand."
)
@click.option(
    "--steady", is_flag=True, help="A hand whose force does not wander (the thesis' runs know only such)."
)
@click.option("--seed", default=1, show_default=True, help="Of the sensors' noise.")
@click.option("--frames", type=click.IntRange(8, 2000), default=50, show_default=True, help="Per stroke.")
@click.option("--strokes", type=click.IntRange(1, 1000), default=1, show_default=True,
              help="Different strokes (seeds) over the lump, one after the other.")  # fmt: skip
@json_option
def command(
    code: str,
    runtime: str,
    listen: str,
    key: Path | None,
    store: Path | None,
    noise: str,
    steady: bool,
    seed: int,
    frames: int,
    strokes: int,
    as_json: bool,
) -> None:
    """Emulate a probe that strokes the lump CODE, until Ctrl-C.

    The firmware runs on real MicroPython behind a pseudo-terminal or a TCP port; its sensors read a
    finite-element stroke with the noise of real cells and of a human hand. Every `palpate stream` begins with
    the first stroke. `palpate devices` and `--port auto` find it.

    \b
    Example:
      palpate emulate d12h07e20f09 --key out/key
      palpate emulate d12h07e20f09 --listen tcp:127.0.0.1:7624 --runtime cpython
    """
    from host.link import emulated
    from sim.probe.emulated import RUNTIMES, EmulatedProbe

    if runtime not in RUNTIMES:
        raise UsageError(f"there is no runtime {runtime!r} to stream from; use {' or '.join(RUNTIMES)}")
    public = _public_key(key)
    check_words(code, noise, listen)
    streams: Any
    streams, calibration = strokes_over(code, noise, seed, frames, strokes, steady)
    probe = EmulatedProbe(
        runtime, streams, listen, store, True, public_key=public, calibration=calibration, roomy=True
    )
    with probe:
        port = ""
        path: Path | None = None
        try:
            while probe.running:
                if probe.port != port:  # also after an unplug, when a pseudo-terminal gets another name
                    port = probe.port
                    if path is not None:
                        path.unlink(missing_ok=True)
                    path = emulated.leave(emulated.Note(port, os.getpid(), code, runtime))
                    _announce(port, code, runtime, as_json)
                time.sleep(POLL_S)
        finally:
            if path is not None:
                path.unlink(missing_ok=True)
        raise PalpateError(
            f"the emulated probe ended: {' '.join(probe.complaints[-3:]) or 'no reason given'}"
        )


def strokes_over(
    code: str, noise: str, seed: int, frames: int, strokes: int, steady: bool = False
) -> tuple[list[FrameStream], Calibration]:
    """What a probe's sensors read of some strokes over one lump, and the calibration it left the bench with.

    Parameters
    ----------
    code : str
        The case. It is simulated at two forces around its own, so that the hand can wander.
    noise : str
        A level of `sim.probe.sensors.LEVELS`.
    seed : int
        Of the first stroke; each further one has the next.
    frames, strokes : int
        Frames per stroke, and strokes.
    steady : bool
        The hand's force does not wander.
    """
    from dataclasses import replace

    import numpy as np

    from sim.probe.sensors import FORCE_RATIO, LEVELS, SensorModel, StrokeField
    from sim.tissue import Case, Settings, simulate_forces

    case = Case.from_code(code)
    low = replace(case, F_rel=case.F_rel / FORCE_RATIO**0.5)
    pair = simulate_forces(low, [low.F_rel, low.F_rel * FORCE_RATIO], Settings(far_start_mm=-44.0))
    level = LEVELS[noise].without("force") if steady else LEVELS[noise]
    probes = [
        SensorModel(StrokeField(*pair), level, seed + k, mean_force_N_per_m=case.F_N_per_m)
        for k in range(strokes)
    ]
    calibration = probes[0].calibration()
    # One emulated probe stands for all of them: it knows the dead cells of each.
    calibration.set_dead([int(cell) for probe in probes for cell in np.flatnonzero(probe.known_dead)])
    return [probe.stroke(frames) for probe in probes], calibration


def check_words(code: str, noise: str, listen: str) -> None:
    """Refuse wrong words before anything is computed."""
    from sim.probe.endpoints import endpoint
    from sim.probe.sensors import LEVELS
    from sim.tissue import Case

    Case.from_code(code)
    if noise not in LEVELS:
        raise UsageError(f"there is no noise level {noise!r}; use {', '.join(LEVELS)}")
    try:
        endpoint(listen).close()
    except ValueError as error:
        raise UsageError(str(error)) from None
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise UsageError(f"cannot listen on {listen!r}: {why}; use pty or tcp:HOST:PORT") from error


def _announce(port: str, code: str, runtime: str, as_json: bool) -> None:
    if as_json:
        print_json({"port": port, "pid": os.getpid(), "code": code, "runtime": runtime})
    else:
        click.echo(port)
        note(f"{code} on {runtime}; try `palpate stream --port {port} --strokes 1`; Ctrl-C ends it")


def _public_key(directory: Path | None) -> bytes | None:
    if directory is None:
        return None
    path = directory / PUBLIC_KEY if directory.is_dir() else directory
    try:
        return path.read_bytes()
    except OSError:
        raise NoSuchFile(
            f"there is no key in {directory}; make one with `palpate keygen {directory}`"
        ) from None
