"""`palpate devices`: ports and the probes behind them."""

from __future__ import annotations

import click

from palpate.console import json_option, note, print_json, say, table


@click.command("devices")
@click.option("--ask/--no-ask", default=True, help="Shake hands with ports that may be a probe.")
@json_option
def command(ask: bool, as_json: bool) -> None:
    """List serial ports and emulated probes, and say which are ready.

    Only ports with known USB hardware and emulated probes are asked; others are listed as they are.

    \b
    Example:
      palpate devices
      palpate devices --json
    """
    from palpate.link.devices import find

    devices = find(ask)
    if as_json:
        print_json([device.as_dict() for device in devices])
        return
    if not devices:
        say("no serial ports; plug a probe in, or start one with `palpate emulate d12h07e20f06`")
        return
    rows = [(d.port, d.state, d.description, d.usb_serial or d.serial, d.model_id) for d in devices]
    table(("port", "state", "what", "serial", "model"), rows)
    for device in devices:
        if device.message and device.state != "silent":
            note(f"  {device.message}")
