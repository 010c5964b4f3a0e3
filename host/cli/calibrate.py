"""`palpate calibrate`: zero and gain of the cells, stored on the probe."""

from __future__ import annotations

from dataclasses import asdict

import click

from palpate.cli.numbers import Finite
from palpate.cli.ports import port_option, tell_damage
from palpate.console import json_option, print_json, say
from palpate.errors import UsageError


@click.command("calibrate")
@click.argument("kind", type=click.Choice(["zero", "gain", "clear"]))
@click.option("--pressure", "pressure_kPa", type=Finite(0.001, 1000.0),
              help="gain: the uniform pressure on the cells, kPa.")  # fmt: skip
@click.option("--frames", type=click.IntRange(1, 255), default=100, show_default=True, help="To average.")
@port_option
@json_option
def command(kind: str, pressure_kPa: float | None, frames: int, port: str, baud: int, as_json: bool) -> None:
    """Calibrate the probe's cells: zero in the air, gain under a known uniform pressure, or clear both.

    The result is stored on the probe. Cells that do not answer the pressure are marked dead.

    \b
    Example:
      palpate calibrate zero
      palpate calibrate gain --pressure 10
    """
    from palpate.link.probe import Probe

    if (kind == "gain") != (pressure_kPa is not None):
        raise UsageError(
            "--pressure belongs to gain, and gain needs it: palpate calibrate gain --pressure 10"
        )
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
