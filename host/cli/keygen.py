"""`palpate keygen`: a signing key, or the successor of one."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError


@click.command("keygen")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--succeeds", type=click.Path(path_type=Path, file_okay=False),
              help="Directory of the key that it takes the place of.")  # fmt: skip
@click.option("--force", is_flag=True, help="With --succeeds: sign although the clock seems to run ahead.")
@json_option
def command(directory: Path, succeeds: Path | None, force: bool, as_json: bool) -> None:
    """Make a signing key (SLH-DSA, FIPS 205); a probe accepts models that it has signed.

    Copies of the directory sign as well as the original: keep one in a safe place, and all of them secret.

    With --succeeds, the old key also signs the new public key into succession.palp; once that file is
    flashed, a probe takes models of the new key and none of the old one.

    \b
    Example:
      palpate keygen out/key
      palpate keygen out/new-key --succeeds out/key
      palpate flash out/new-key/succession.palp
    """
    from palpate.model_export.signing import keys

    if directory == Path():
        raise UsageError("the key gets a directory of its own: name one")
    public = keys.generate(directory, succeeds=succeeds, force=force)
    result = {"directory": directory, "public_key": public}
    if succeeds is not None:
        result["succession"] = directory / keys.SUCCESSION
    if as_json:
        print_json(result)
        return
    say(str(directory))
    note(f"the probe gets {directory / 'public.key'} ({len(public)} bytes)")
    if succeeds is not None:
        note(f"or, if it knows the old key, flash {directory / keys.SUCCESSION}")
