"""`palpate export`: a fitted model as a signed image for the probe."""

from __future__ import annotations

from pathlib import Path

import click

from host.cli.output import json_option, note, print_json
from host.files import whole_file


@click.command("export")
@click.argument("model", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--key", required=True, type=click.Path(path_type=Path), help="Directory made by keygen.")
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.palp.")
@click.option("--rollback", is_flag=True, help="Let it replace newer models.")
@click.option("--adopt", is_flag=True, help="Take over a key that has signed on another machine.")
@json_option
def command(model: Path, key: Path, out: Path, rollback: bool, adopt: bool, as_json: bool) -> None:
    """Compile a model to fixed point, prove its bounds, measure its error against float64, and sign it.

    \b
    Example:
      palpate keygen out/key
      palpate export out/model.json --key out/key --out out/model.palp
    """
    from model_export.exporter import export
    from model_export.schema import ModelSpec

    spec = ModelSpec.load(model)
    image, report = export(spec, key, rollback=rollback, adopt=adopt)
    with whole_file(out) as path:
        path.write_bytes(image)
    if as_json:
        print_json({"out": out, **report.to_dict()})
        return
    click.echo(str(out))
    for line in report.lines():
        note(line)
