"""`palpate compile`: a fitted regression of scikit-learn or statsmodels as proven integers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError
from palpate.files import by_suffix, check_writable, whole_file

if TYPE_CHECKING:
    import pandas as pd

    from palpate.fixedpoint import Program


@click.command("compile")
@click.argument("model", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--data", required=True, type=click.Path(path_type=Path, dir_okay=False),
              help="Table (.csv, .parquet) that the model is for: it sets ranges and precision.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False),
              help="As model.py, model.mpy, model.c, model.h, or model.palp for slots.")  # fmt: skip
@click.option(
    "--target", multiple=True, metavar="COLUMN", help="A column that is no feature; may be repeated."
)
@click.option("--calibrate", type=click.Path(path_type=Path, dir_okay=False), metavar="TABLE",
              help="Rows that the model was not fitted to: adds intervals and a domain flag.")  # fmt: skip
@click.option("--level", type=float, default=0.9, show_default=True, help="Of these intervals.")
@click.option(
    "--unit", multiple=True, metavar="UNIT", help="Of an output, as mm; one for each, in their order."
)
@click.option(
    "--arch", default="bytecode", show_default=True, help="Of a .mpy: bytecode, armv6m, armv7em ..."
)
@click.option("--key", type=click.Path(path_type=Path, file_okay=False),
              help="Of a .mpy or .palp: sign it by this directory, made by keygen.")  # fmt: skip
@click.option("--like", type=click.Path(path_type=Path), metavar="MODEL",
              help="Of a .palp: the model with whose force map its features were computed, a model.json or a "
              "name as field; its lump rule and border of hardness hold, too.")  # fmt: skip
@click.option("--device", metavar="NAME",
              help="Of a .palp: for a board of your own by this name, 16 characters at most, not for a "
              "probe.")  # fmt: skip
@click.option("--trust", is_flag=True, help="Read a pickle although it may run any code.")
@json_option
def command(
    model: Path,
    data: Path,
    out: Path,
    target: tuple[str, ...],
    calibrate: Path | None,
    level: float,
    unit: tuple[str, ...],
    arch: str,
    key: Path | None,
    like: Path | None,
    device: str | None,
    trust: bool,
    as_json: bool,
) -> None:
    """Compile a fitted regression to integers without floats, with a proof that nothing overflows.

    MODEL is a pipeline, regressor or classifier of scikit-learn: a .skops file, or with --trust a .joblib or
    .pkl, which may also hold results of statsmodels. Printed are the proof, and what the integers add to
    float64's errors.

    A .palp is for slots, those of a probe or with --device those of a board of your own: of a linear model,
    with --calibrate and --key. For a probe its features and targets have the names of the probe's (d_mm ...).

    \b
    Example:
      palpate compile model.skops --data train.csv --target d_mm --out model.py
      palpate compile model.joblib --trust --data train.csv --out model.c
      palpate compile model.skops --data a.csv --target d_mm --calibrate b.csv --key out/key --out model.palp
    """
    from palpate.cli.fitted import read_model, read_table
    from palpate.cli.real import load_model

    write = by_suffix(
        out,
        {
            ".py": lambda program: program.python().encode(),
            ".mpy": lambda program: program.mpy(arch),
            ".c": lambda program: program.c().encode(),
            ".h": lambda program: program.c().encode(),
            ".palp": lambda program: program.image(key, like and load_model(like), device=device),
        },
    )
    if calibrate is not None and not target:
        raise UsageError("--calibrate needs --target, the columns that hold what the model should say")
    kind = out.suffix.lower()
    if arch != "bytecode" and kind != ".mpy":
        raise UsageError("--arch is of a .mpy; name --out so")
    if key is not None and kind not in (".mpy", ".palp"):
        raise UsageError("--key is of a .mpy or .palp; name --out so")
    if like is not None and kind != ".palp":
        raise UsageError("--like is of a .palp; name --out so")
    if device is not None and kind != ".palp":
        raise UsageError("--device is of a .palp; name --out so")
    if key is None and kind == ".palp":
        raise UsageError("slots take no model that is not signed; give --key, a directory made by keygen")
    check_writable(out)
    fitted, table = read_model(model, trust), read_table(data)
    beside = None if calibrate is None else (read_table(calibrate), calibrate)
    program, source = _compiled(fitted, table, data, target, beside, level, unit, write)
    if key is not None and kind == ".mpy":
        from palpate.model_export.signing import keys

        source = keys.sign_program(key, source)
    with whole_file(out) as path:
        path.write_bytes(source)
    if as_json:
        print_json({"out": out, "bytes": len(source), **_told(program)})
        return
    say(str(out))
    note(str(program.proof))
    for error in program.errors:
        note(str(error))
    note(f"{len(source):,} bytes, of {len(program.features)} features and {len(program.outputs)} outputs")
    if device is not None:
        from palpate.model_export.program_image import device_outputs

        for k, o in enumerate(device_outputs(program)):
            ends = f"its interval's ends are out[{3 * k + 1}] and out[{3 * k + 2}]"
            note(f"out[{3 * k}] times {o.step:g} is {o.name} in {o.unit or 'its unit'}; {ends}")


def _compiled(
    fitted: Any,
    table: pd.DataFrame,
    data: Path,
    targets: tuple[str, ...],
    beside: tuple[pd.DataFrame, Path] | None,
    level: float,
    units: tuple[str, ...],
    write: Any,
) -> tuple[Program, bytes]:
    """The program and its source; UsageError in the compiler's own words."""
    from palpate.cli.fitted import features_of, finite, is_of_statsmodels
    from palpate.fixedpoint import CompileError, from_sklearn, from_statsmodels

    by_name = is_of_statsmodels(fitted) or getattr(fitted, "feature_names_in_", None) is not None

    def as_fitted(X: pd.DataFrame) -> Any:
        return X if by_name else X.to_numpy()

    X, calibrate = features_of(fitted, table, data, targets), None
    if beside is not None:
        rows, path = beside
        unmet = as_fitted(features_of(fitted, rows, path, targets))
        calibrate = (unmet, finite(rows[list(targets)], path).to_numpy())
    read = from_statsmodels if is_of_statsmodels(fitted) else from_sklearn
    words: dict[str, Any] = {
        "units": units or None, "calibrate": calibrate, "names": list(X.columns), "level": level,
    }  # fmt: skip
    if calibrate is not None:
        words["output_names"] = targets
    try:
        program = read(fitted, as_fitted(X), **words)
        return program, write(program)
    except CompileError as error:
        raise UsageError(str(error)) from None


def _told(program: Program) -> dict[str, Any]:
    """What `--json` says of a program."""
    return {
        "largest": program.proof.largest,
        "headroom_bits": program.proof.headroom_bits,
        "narrowest": program.proof.where,
        "errors": [vars(error) for error in program.errors],
        "features": [{"name": f.name, "step": f.step, "lo": f.lo, "hi": f.hi} for f in program.features],
        "outputs": [vars(output) for output in program.outputs],
        "classes": list(program.classes),
    }
