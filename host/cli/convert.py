"""`palpate convert`: a recording as a table."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.cli.ports import NOMINAL_SCALE
from palpate.console import json_option, note, print_json, say


@click.command("convert")
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--to", type=click.Choice(["table", "ros2", "lerobot"]), default="table", show_default=True,
              help="ros2: OUT ends in .mcap. lerobot: OUT is a new directory.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Replace tables that are there.")
@json_option
def command(recording: Path, out: Path, to: str, overwrite: bool, as_json: bool) -> None:
    """Write a recording as a table: OUT ends in .parquet, .h5 or .csv. Or for ROS 2 or LeRobot.

    One row per frame: seq, time_us (the probe's clock), host_time_ns, position_mm, displacement_mm and the
    pressures of the 16 x 26 cells in kPa, by the calibration that the recording holds. The estimates go
    beside them (HDF5: a group; else OUT.estimates.*).

    \b
    Example:
      palpate convert visit.mcap visit.parquet
      palpate convert visit.mcap visit.csv
      palpate convert visit.mcap visit.ros2.mcap --to ros2
      palpate convert visit.mcap dataset --to lerobot
    """
    from palpate.recording.convert import convert
    from palpate.recording.reader import Recording

    done = convert(recording, out, overwrite, to)
    if damage := Recording(recording).check():
        note(damage)
    if done.frames and not done.calibrated:
        note(f"{recording} holds no calibration: {NOMINAL_SCALE}")
    if as_json:
        print_json(
            {
                "files": done.files,
                "frames": done.frames,
                "estimates": done.estimates,
                "lost": done.lost,
                "calibrated": done.calibrated,
            }
        )
        return
    note(f"{done.frames} frames ({done.lost} lost on the link), {done.estimates} estimates")
    for path in done.files:
        say(str(path))
