"""The command `palpate`: one small module per command, imported when it is called."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.cli import logs
from palpate.cli.runner import CommandGroup, run


def _use_array(_context: click.Context, _option: click.Parameter, path: Path | None) -> None:
    if path is not None:
        from palpate import array

        array.use(path)


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(package_name="palpate", message="palpate %(version)s")
@click.option(
    "--array",
    type=click.Path(path_type=Path),
    expose_value=False,
    is_eager=True,
    callback=_use_array,
    help="Another sensor array: a copy of firmware_py/sensor_array.py, or 16x32@3mm,25kPa.",
)
def cli() -> None:
    """One stroke of a tactile probe, one estimate of the lump under it.

    The chain: simulate strokes over tissue, fit a model to what the probe would feel, export it as a signed
    fixed-point image, flash it, and let the probe work out diameter, depth and stiffness by itself.

    \b
    Start here:
      palpate demo                          the whole chain, in three minutes
      palpate simulate d10h08e10f10         one finite-element stroke
      palpate doctor                        is this machine ready?

    A case code such as d10h08e10f10 reads: diameter 10 mm, fat over the lump 0.8 diameters thick, stiffness
    10 times the fat's, force 1.0 (100 N per metre of probe width).
    """


cli.params += logs.options()


def main(args: list[str] | None = None) -> int:
    """Entry point; returns the exit status (0 done, 1 the work failed, 2 the arguments were invalid)."""
    return run(cli, args)
