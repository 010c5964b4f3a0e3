"""`palpate export`: a fitted model as a signed image for the probe."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from firmware_py.model_image import MAX_COUNTER
from palpate.cli.real import load_model
from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError
from palpate.files import check_writable, whole_file

if TYPE_CHECKING:
    from palpate.model_export.schema import ModelSpec


@click.command("export")
@click.argument("model", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--key", required=True, type=click.Path(path_type=Path), help="Directory made by keygen.")
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.palp.")
@click.option("--emit-py", type=click.Path(path_type=Path, dir_okay=False),
              help="Also write the model as a readable MicroPython module.")  # fmt: skip
@click.option(
    "--emit-mpy", type=click.Path(path_type=Path, dir_okay=False), help="The same, compiled to .mpy."
)
@click.option(
    "--arch", default="bytecode", show_default=True, help="Of --emit-mpy: bytecode, armv6m, armv7em ..."
)
@click.option(
    "--rollback", is_flag=True, help="Let it replace newer models that this directory's key has signed."
)
@click.option("--counter", type=click.IntRange(0, MAX_COUNTER), metavar="N",
              help="Of --rollback: replace models of the key's other homes up to this counter.")  # fmt: skip
@click.option("--port", help="Of --rollback: ask the probe there for its counter.")
@click.option("--force", is_flag=True, help="Sign although the clock seems to run ahead.")
@json_option
def command(
    model: Path,
    key: Path,
    out: Path,
    emit_py: Path | None,
    emit_mpy: Path | None,
    arch: str,
    rollback: bool,
    counter: int | None,
    port: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Compile a model to fixed point, prove its bounds, measure its error against float64, and sign it.

    MODEL is what `palpate fit` wrote, or `field`, the model that comes with Palpate.

    \b
    Example:
      palpate keygen out/key
      palpate export out/model.json --key out/key --out out/model.palp
      palpate export out/model.json --key out/key --out out/model.palp --emit-mpy out/model.mpy --arch armv6m
      palpate export out/old.json --key out/key --out out/old.palp --rollback --port auto
    """
    from palpate.model_export.exporter import export

    if not rollback and (counter is not None or port is not None):
        raise UsageError("--counter and --port are for --rollback")
    spec = load_model(model)
    files = _emitted(spec, emit_py, emit_mpy, arch)
    for place in (out, *files):
        check_writable(place)  # before anything is signed
    held = max(counter or 0, 0 if port is None else _held(port))
    seen_s = model.stat().st_mtime if model.is_file() else 0.0
    image, report = export(spec, key, rollback=rollback, held=held, seen_s=seen_s, force=force)
    for place, content in {out: image, **files}.items():
        with whole_file(place) as path:
            path.write_bytes(content)
    if as_json:
        print_json({"out": out, "emitted": list(files), **report.to_dict()})
        return
    for place in (out, *files):
        say(str(place))
    for line in report.lines():
        note(line)


def _held(port: str) -> int:
    """The security counter that the probe at `port` holds."""
    from palpate.link.flash import held_counter
    from palpate.link.probe import Probe

    with Probe.open(port) as probe:
        return held_counter(probe)


def _emitted(spec: ModelSpec, emit_py: Path | None, emit_mpy: Path | None, arch: str) -> dict[Path, bytes]:
    """The model as modules for probes without the evaluator: path to content."""
    from palpate.model_export.source import emit

    files = {}
    if emit_py is not None:
        files[emit_py] = emit.emit_py(spec).encode()
    if emit_mpy is not None:
        files[emit_mpy] = emit.emit_mpy(spec, arch)
    return files
