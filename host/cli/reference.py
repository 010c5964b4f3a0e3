"""`palpate reference`: a press beside the lump, kept on the probe for the visit."""

from __future__ import annotations

from dataclasses import asdict

import click

from palpate.cli.ports import port_option, tell_damage
from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError


@click.command("reference")
@click.option("--clear", is_flag=True, help="Forget it: another person, or another place, comes next.")
@click.option("--show", is_flag=True, help="Only say what the probe keeps.")
@port_option
@json_option
def command(clear: bool, show: bool, port: str, baud: int, as_json: bool) -> None:
    """Press once beside the lump, 30 to 40 mm away: it tells the probe more of the tissue.

    Hold the probe in the air, press it straight down within about a second, as hard as you stroke, lift it,
    and hold it in the air for another second.
    What it says of fat and gland joins what the press before each stroke says, until the power goes, another
    reference is taken, or --clear. Where a stroke's own press does not fit it, the stroke says so and goes
    without. It takes a model that works its tissue out, and no stream may run.

    \b
    Example:
      palpate reference
      palpate stream --strokes 3
      palpate reference --clear
    """
    from palpate.link.probe import Probe

    if clear and show:
        raise UsageError("--clear and --show are two different wishes: give one")
    with Probe.open(port, baud) as probe:
        tell_damage(probe)
        if clear:
            probe.clear_reference()
            found = None
        elif show:
            found = probe.reference()
        else:
            note(
                "hold the probe in the air; press it straight down beside the lump; lift it and wait a second"
            )
            found = probe.take_reference()
    if as_json:
        print_json({"held": found is not None, **(asdict(found) if found is not None else {})})
    elif found is None:
        say("the probe keeps no reference press")
    else:
        say(
            f"reference: fat of {found.E_fat_kPa:.1f} kPa, {found.t_mm:.1f} mm thick; "
            "it joins the strokes from now on"
        )
