"""`palpate doctor`: is this machine ready, and is a probe that was just built?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click
from rich.markup import escape

from palpate.cli.numbers import Finite
from palpate.cli.ports import tell_damage
from palpate.console import console, json_option, note, print_json, printable, say, table
from palpate.errors import PalpateError, UsageError

if TYPE_CHECKING:
    from palpate.doctor import Finding

MARKS = {"ok": "[green]ok[/green]", "missing": "[yellow]missing[/yellow]", "broken": "[red]broken[/red]"}


@click.command("doctor")
@click.option("--port", help="Look at the probe there instead: a port, a serial number or auto.")
@click.option("--baud", default=921_600, show_default=True, help="Of a UART.")
@click.option("--push", "push_mm", type=Finite(5, 500), metavar="MM",
              help="Push it so far along a ruler, pressing a little, and back, in ten seconds.")  # fmt: skip
@click.option("--sizes", is_flag=True, help="Print what each package takes on the disk instead.")
@json_option
def command(port: str | None, baud: int, push_mm: float | None, sizes: bool, as_json: bool) -> None:
    """Look at this machine: packages, solver, emulators, browser, ports, groups, probes; say what to do.

    Exits with 1 if something that a command needs is broken; what is only missing is optional.

    With --port it looks at a probe that lies still with nothing on its face: cells at a rail, cells that
    never move, noise, zeros and frame rate. With --push it looks at one that moves: direction and scale of
    the wheel, missed edges, and the potentiometer.

    \b
    Example:
      palpate doctor
      palpate doctor --sizes
      palpate doctor --port auto
      palpate doctor --port auto --push 50
    """
    if sizes:
        _print_sizes(as_json)
        return
    findings = []
    for finding in _looked_at(port, baud, push_mm):
        findings.append(finding)
        if not as_json:
            console().print(
                f"{MARKS[finding.state]:>28}  {finding.name:12} {escape(printable(finding.found))}"
            )
            if finding.todo:  # escaped: the brackets of 'palpate[view]' are no markup
                console().print(f"{'':22}[dim]{escape(printable(finding.todo))}[/dim]")
    if as_json:
        print_json([finding.as_dict() for finding in findings])
    broken = [finding.name for finding in findings if finding.state == "broken"]
    if broken:
        raise PalpateError(f"not ready: {', '.join(broken)}; the lines above say what to do")


def _print_sizes(as_json: bool) -> None:
    from dataclasses import asdict

    from palpate.sizes import sizes

    found = sizes()
    if as_json:
        print_json([asdict(size) for size in found])
        return
    rows = [(size.name, f"{size.MB:.1f}", escape(size.asked_by)) for size in found if size.MB >= 1.0]
    table(("package", "MB", "for"), rows)
    small = [size.MB for size in found if size.MB < 1.0]
    needed = sum(size.MB for size in found if "[" not in size.asked_by)
    say(f"{len(small)} more under 1 MB, {sum(small):.0f} MB; all {sum(s.MB for s in found):.0f} MB, "
               f"{needed:.0f} MB of them without extras")  # fmt: skip


def _looked_at(port: str | None, baud: int, push_mm: float | None) -> Iterator[Finding]:
    from palpate.doctor import examine

    if port is None:
        if push_mm is not None:
            raise UsageError("--push needs --port")
        yield from examine()
        return
    from palpate.first_light import first_light
    from palpate.link.probe import Probe

    with Probe.open(port, baud) as probe:
        tell_damage(probe)
        if push_mm:
            note(f"push the probe {push_mm:g} mm along a ruler and back, now")
        yield from first_light(probe, push_mm or 0.0)
