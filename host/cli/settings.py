"""`palpate settings`: what can be set on the probe."""

from __future__ import annotations

import click

from palpate.cli.ports import port_option, tell_damage
from palpate.console import json_option, print_json, table


@click.command("settings")
@click.argument("name", required=False)
@click.argument("value", type=int, required=False)
@port_option
@json_option
def command(name: str | None, value: int | None, port: str, baud: int, as_json: bool) -> None:
    """Show the probe's settings with their limits, or set one; it is stored on the probe.

    \b
    Example:
      palpate settings
      palpate settings frame_rate 100000
    """
    from firmware_py import messages
    from palpate.link.commands import setting_key
    from palpate.link.probe import Probe

    if name is not None:
        setting_key(name)  # a wrong word is told before the port is opened
    with Probe.open(port, baud) as probe:
        tell_damage(probe)
        if name is not None and value is not None:
            probe.set_setting(name, value)
        wanted = [row for row in messages.SETTINGS if name in (None, row[1])]
        rows = [
            (row[1], probe.get_setting(row[1]), row[2], *probe.setting_limits(row[1]), row[5])
            for row in wanted
        ]
    names = ("name", "value", "unit", "lowest", "highest", "default")
    if as_json:
        print_json([dict(zip(names, row)) for row in rows])
    else:
        table(names, [[str(cell) for cell in row] for row in rows])
