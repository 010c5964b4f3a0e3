"""`palpate import`: frames of anybody's sensor as recordings."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError
from palpate.files import read_whole
from palpate.first_time import announce


@click.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--as", "declared", type=click.Path(path_type=Path, dir_okay=False),
              help="What the frames are: rows, columns, pitch, names and units, in a TOML file.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, file_okay=False),
              help="Directory for the recordings, one a file.")  # fmt: skip
@click.option("--model", type=click.Path(path_type=Path, dir_okay=False),
              help="Model image for the estimates; else `thesis-tissue`, without a press.")  # fmt: skip
@click.option("--position", "track", type=click.Path(path_type=Path, dir_okay=False),
              help="CSV of places for a recording: time_s, position_mm, displacement_mm.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Replace recordings that are there.")
@json_option
def command(
    files: tuple[Path, ...],
    declared: Path | None,
    out: Path,
    model: Path | None,
    track: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Make recordings of FILES: CSV, Parquet, NPZ, HDF5, or a recording by another array; two published
    layouts, presses in a .mat file and LESS' palpations in HDF5, by the names that docs/howto/real-strokes.md
    gives their arrays.

    Frames may be of any array at any pitch; they are resampled to the array in use, no force lost, or taken
    as they are where --array names theirs. What is missing is said: without displacement only the pressure
    counts, without positions a steady speed is assumed.

    \b
    Example:
      palpate import lump-*.csv --as sensor.toml --out out/real

    \b
    A sensor.toml, for columns as p_0_0 and x_mm; time, displacement and stroke go as position does:
      rows = 8
      columns = 12
      pitch_mm = 3.0
      frames_per_s = 40
      [pressure]
      name = "p_{row}_{column}"
      unit = "kPa"
      [position]
      name = "x_mm"
    """
    from palpate import models
    from palpate.importing import declaration, importer

    said = None if declared is None else declaration.read(declared)
    targets = [out / f"{file.stem}.mcap" for file in files]
    for k, target in enumerate(targets):
        if target in targets[:k]:
            raise UsageError(f"{files[k]} and another file would both become {target}; import them apart")
        if target.exists() and target.resolve() == files[k].resolve():
            raise UsageError(f"{files[k]} would replace itself; choose another --out")
    image = None if model is None else read_whole(model, "model image")
    announce(solver=False, firmware=True)
    if image is None and track is None and models.suits_array():
        from palpate.link import emulator_model as emulator

        image = emulator.image(models.TOLD)
    done = []
    for file, target in zip(files, targets):
        found = importer.import_file(file, target, said, image, overwrite, track)
        done.append(found.to_dict())
        if not as_json:
            say(f"{target}: {found.strokes} strokes, {found.frames} frames")
            for remark in found.remarks:
                note(f"  {remark}")
    if as_json:
        print_json({"recordings": done})
