"""`palpate board`: the firmware for a board that one has built."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.cli.emulate import public_key
from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError


@click.command("board")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--key", type=click.Path(path_type=Path), help="Directory of the key whose models it accepts.")
@click.option("--uart", is_flag=True, help="The board talks over its UART (GP0, GP1), not over USB.")
@click.option("--slots", is_flag=True, help="Only what takes and runs models, for a main.py of your own.")
@json_option
def command(directory: Path, key: Path | None, uart: bool, slots: bool, as_json: bool) -> None:
    """Compile the firmware for the reference board, ready for `mpremote`.

    The directory gets the files that the board needs: the firmware in MicroPython's compiled form, with
    machine code for the RP2040, `main.py`, and your public key. A board without a key takes no model. With
    --slots it gets a folder `firmware_py` for a board that is no probe.

    \b
    Example:
      palpate board out/board --key out/key
      mpremote fs cp out/board/main.py out/board/firmware.pack out/board/key.pub :
    """
    from palpate.files import cannot_write, whole_file
    from palpate.sim.probe.rp2040.board_files import KEY, board_files, slot_files

    if slots and uart:
        raise UsageError("--uart is of a probe; with --slots your own main.py says what the board talks over")
    public = public_key(key)
    files = slot_files(public) if slots else board_files(public, uart)
    try:
        (directory / KEY).unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(directory, error) from error
    for name, data in files.items():
        with whole_file(directory / name) as part:
            part.write_bytes(data)
    size = sum(map(len, files.values()))
    if as_json:
        print_json({"directory": directory, "files": sorted(files), "bytes": size, "key": public is not None})
        return
    say(str(directory))
    paths = " ".join(str(directory / name) for name in sorted({name.split("/")[0] for name in files}))
    how = "cp -r" if slots else "cp"
    note(f"{len(files)} files, {size} bytes; onto the board: mpremote fs {how} {paths} :")
    if not public:
        note("without --key the board takes no model")
