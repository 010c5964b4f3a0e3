"""`palpate doctor`: is this machine ready?"""

from __future__ import annotations

import click
from rich.markup import escape

from palpate.cli.output import console, json_option, print_json
from palpate.errors import PalpateError

MARKS = {"ok": "[green]ok[/green]", "missing": "[yellow]missing[/yellow]", "broken": "[red]broken[/red]"}


@click.command("doctor")
@json_option
def command(as_json: bool) -> None:
    """Look at this machine: packages, solver, emulators, browser, ports, groups, probes; say what to do.

    Exits with 1 if something that a command needs is broken; what is only missing is optional.

    \b
    Example:
      palpate doctor
    """
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
