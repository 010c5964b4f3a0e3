"""`palpate doctor`: is this machine ready?"""

from __future__ import annotations

import click
from rich.markup import escape

from palpate.cli.output import console, json_option, print_json, table
from palpate.errors import PalpateError

MARKS = {"ok": "[green]ok[/green]", "missing": "[yellow]missing[/yellow]", "broken": "[red]broken[/red]"}


@click.command("doctor")
@click.option("--sizes", is_flag=True, help="Print what each package takes on the disk instead.")
@json_option
def command(sizes: bool, as_json: bool) -> None:
    """Look at this machine: packages, solver, emulators, browser, ports, groups, probes; say what to do.

    Exits with 1 if something that a command needs is broken; what is only missing is optional.

    \b
    Example:
      palpate doctor
      palpate doctor --sizes
    """
    if sizes:
        _print_sizes(as_json)
        return
    from palpate.doctor import examine

    findings = []
    for finding in examine():
        findings.append(finding)
        if not as_json:
            console().print(f"{MARKS[finding.state]:>28}  {finding.name:12} {escape(finding.found)}")
            if finding.todo:  # escaped: the brackets of 'palpate[view]' are no markup
                console().print(f"{'':22}[dim]{escape(finding.todo)}[/dim]")
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
    click.echo(f"{len(small)} more under 1 MB, {sum(small):.0f} MB; all {sum(s.MB for s in found):.0f} MB, "
               f"{needed:.0f} MB of them without extras")  # fmt: skip
