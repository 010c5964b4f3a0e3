"""`palpate demo`: the whole chain in one command."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from palpate.console import json_option, print_json


@click.command("demo")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("out/demo"),
              show_default=True, help="Directory of everything it makes.")  # fmt: skip
@click.option("--runtime", type=click.Choice(["micropython", "cpython"]), default="micropython",
              show_default=True, help="What carries the probe's firmware.")  # fmt: skip
@click.option("--fresh", is_flag=True, help="Compute the strokes again.")
@json_option
def command(out: Path, runtime: str, fresh: bool, as_json: bool) -> None:
    """Tissue, fit, export, flash, stroke, estimate: the whole chain, nothing faked in between.

    Three minutes the first time, one the second. Ends with the probe's own estimate beside the truth, what
    three strokes say together, the host's replay, a recording, a picture and a report.

    \b
    Example:
      palpate demo
    """
    from palpate.demo import run

    result = run(out, runtime, fresh, stderr=as_json)
    if as_json:
        print_json(asdict(result))
