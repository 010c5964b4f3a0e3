"""`palpate calibrate`: zero and gain of the cells, stored on the probe."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from palpate.cli.numbers import Finite
from palpate.cli.ports import port_option, tell_damage
from palpate.console import json_option, print_json, say
from palpate.errors import UsageError
from palpate.link.schemes import address_of, source_of

if TYPE_CHECKING:
    from palpate.link.schemes import Address


@click.command("calibrate")
@click.argument("kind", type=click.Choice(["zero", "gain", "drift", "clear"]))
@click.option("--pressure", "pressure_kPa", type=Finite(0.001, 1000.0),
              help="gain: the uniform pressure on the cells, kPa.")  # fmt: skip
@click.option("--frames", type=click.IntRange(1, 255), default=100, show_default=True, help="To average.")
@click.option("--seconds", type=Finite(1, 86_400), default=60.0, show_default=True,
              help="drift: so long is the air watched.")  # fmt: skip
@port_option
@json_option
def command(
    kind: str,
    pressure_kPa: float | None,
    frames: int,
    seconds: float,
    port: str,
    baud: int,
    as_json: bool,
) -> None:
    """Calibrate the cells: zero in the air, gain under a known uniform pressure, or clear both.

    The result is stored on the probe. Cells that do not answer the pressure are marked dead.

    Other people's arrays keep nothing: theirs is a file beside the recordings. Repeat gain at three
    pressures or more, and each cell has a response curve of its own. drift watches such an array in the air.

    \b
    Example:
      palpate calibrate zero
      palpate calibrate gain --pressure 10
      palpate calibrate drift --port "flexitac:/dev/ttyUSB0?rows=16&cols=32&pitch=3"
    """
    from palpate.link.probe import Probe

    if (kind == "gain") != (pressure_kPa is not None):
        raise UsageError(
            "--pressure belongs to gain, and gain needs it: palpate calibrate gain --pressure 10"
        )
    if (address := address_of(port)) is not None:
        done_: dict[str, Any] = _of_an_array(address, kind, pressure_kPa, frames, seconds)
        said = done_.pop("said")
        if as_json:
            print_json({"kind": kind, "pressure_kPa": pressure_kPa, **done_})
        else:
            say(f"{kind}: {said}")
        return
    if kind == "drift":
        raise UsageError("drift is of other people's arrays; a probe's is measured by palpate characterise")
    with Probe.open(port, baud) as probe:
        tell_damage(probe)
        if kind == "clear":
            done = probe.forget_calibration()
        elif pressure_kPa is None:
            done = probe.calibrate_zero(frames)
        else:
            done = probe.calibrate_gain(pressure_kPa, frames)
    if as_json:
        print_json({"kind": kind, "pressure_kPa": pressure_kPa, **asdict(done)})
    elif kind == "clear":
        say("the calibration is forgotten; zero and gain are nominal")
    else:
        noise = f"noise {done.noise_counts:.2f} counts"
        say(f"{kind}: {done.frames} frames, {noise}, {done.dead_cells} dead cells")


def _of_an_array(
    address: Address, kind: str, pressure_kPa: float | None, frames: int, seconds: float
) -> dict[str, Any]:
    """Calibrate an array that keeps nothing; what was found, and `said` in words."""
    from palpate.sources import calibrate

    if kind == "clear":
        return calibrate.clear(address)
    if kind == "drift":
        return calibrate.watch(address, source_of(address), seconds)
    return calibrate.take(address, source_of(address), pressure_kPa, frames)
