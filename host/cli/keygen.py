"""`palpate keygen`: a signing key."""

from __future__ import annotations

from pathlib import Path

import click

from host.cli.output import json_option, note, print_json, progress


@click.command("keygen")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--height", type=click.Choice(["5", "10", "15"]), default="10", show_default=True,
              help="Signatures the key can give: 2^height.")  # fmt: skip
@click.option("--width", type=click.Choice(["4", "8"]), default="8", show_default=True,
              help="Bits per digit: 8 is smaller, 4 quicker to verify on the probe.")  # fmt: skip
@json_option
def command(directory: Path, height: str, width: str, as_json: bool) -> None:
    """Make a signing key (LMS, RFC 8554); a probe accepts models that it has signed.

    The directory remembers which signatures were given: never copy it back from a backup.

    \b
    Example:
      palpate keygen out/key
    """
    from model_export import keys

    with progress("leaves") as bar:
        task = bar.add_task("growing the key", total=None)
        public = keys.generate(
            directory,
            int(height),
            int(width),
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if as_json:
        print_json({"directory": directory, "public_key": public, "signatures": 1 << int(height)})
        return
    click.echo(str(directory))
    note(f"signs {1 << int(height)} models; the probe gets {directory / 'public.key'} ({len(public)} bytes)")
