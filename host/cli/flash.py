"""`palpate flash`: a model onto a probe."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import click

from palpate.cli.ports import port_option, tell_damage
from palpate.console import json_option, print_json, progress, say
from palpate.files import read_whole


@click.command("flash")
@click.argument("image", type=click.Path(path_type=Path))
@port_option
@json_option
def command(image: Path, port: str, baud: int, as_json: bool) -> None:
    """Make a signed model image the live model of a probe.

    The probe checks signature, versions and self-test before it trusts anything; until it does, and if the
    power or the line fails at any moment, the model it had stays. Run it again to go on.

    \b
    Example:
      palpate flash model.palp --port auto
    """
    from palpate.link.flash import flash
    from palpate.link.probe import Probe
    from palpate.model_export.check_image import check_image, is_succession
    from palpate.model_export.image_builder import inspect

    data = read_whole(image, "model image")
    check_image(data)
    with Probe.open(port, baud) as probe:
        tell_damage(probe)
        before = probe.identity.model_id
        began = time.monotonic()
        with progress("bytes") as bar:
            task = bar.add_task("flashing", total=len(data))
            done = flash(probe, data, lambda at, size: bar.update(task, completed=at, total=size))
        seconds = time.monotonic() - began
        adapted = "" if is_succession(data) else inspect(data).adapted
        summary = asdict(done) | {
            "port": probe.name, "replaced": before, "seconds": seconds, "adapted": adapted
        }  # fmt: skip
    if as_json:
        print_json(summary)
    elif is_succession(data):
        say(f"{summary['port']}: from now on it takes models of the new key only; what is live stays")
    else:
        was = f" (was {before})" if before and before != done.model_id else ""
        say(
            f"{summary['port']}: model {done.model_id} is live{was}; {done.size} bytes in {seconds:.1f} s"
            + (f"; {adapted}" if adapted else "")
        )
