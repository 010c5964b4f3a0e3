"""`palpate example`: the example scripts, copied to where one works."""

from __future__ import annotations

import ast
import json
import shutil
from pathlib import Path

import click

import palpate
from palpate.console import json_option, note, print_json, say
from palpate.errors import UsageError
from palpate.files import whole_file

_HERE = Path(palpate.__file__).parent
_FOLDERS = (_HERE / "examples", _HERE.parent / "docs" / "examples", _HERE.parent / "tests")
"""Where a wheel has them; where a clone has them."""
_BESIDE = {"foreign_world": ("foreign_world.npz",)}
_NAMES = (
    "one_stroke", "table_1", "noise_and_error", "talk_to_a_probe", "integers_and_floats",
    "recording_in_pandas", "first_hour", "foreign_world", "c",
)  # fmt: skip
_C = "A client for the wire in C: the generated header and a whole program on it."


@click.command("example")
@click.argument("name", required=False, type=click.Choice(_NAMES), metavar="[NAME]")
@click.option("--to", type=click.Path(path_type=Path, file_okay=False), default=Path("."), show_default=True,
              help="Folder to copy into.")  # fmt: skip
@json_option
def command(name: str | None, to: Path, as_json: bool) -> None:
    """List the examples, or copy one: plain scripts to change, a notebook, a client in C.

    Files that are there are not written over.

    \b
    Example:
      palpate example
      palpate example one_stroke
      python one_stroke.py
    """
    if name is None:
        found = {known: _first_line(_paths(known)[0]) for known in _NAMES}
        if as_json:
            print_json({"examples": found})
            return
        for known, line in found.items():
            say(f"{known:20} {line}")
        note("copy one with `palpate example NAME`")
        return
    paths = _paths(name)
    places = [to / path.name for path in paths]
    for place in places:
        if place.exists():
            raise UsageError(f"{place} exists already; choose another folder with --to")
    for path, place in zip(paths, places):
        for file in [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]:
            with whole_file(place / file.relative_to(path)) as part:
                shutil.copy(file, part)
    if as_json:
        print_json({"files": places})
        return
    for place in places:
        say(str(place))
    if places[0].suffix == ".py":
        note(f"run it with `python {places[0]}`")


def _paths(name: str) -> list[Path]:
    """An example's files, or its folder; the one to run first."""
    wanted = [name if name == "c" else f"{name}.ipynb" if name == "first_hour" else f"{name}.py"]
    found = []
    for file in (*wanted, *_BESIDE.get(name, ())):
        there = [folder / file for folder in _FOLDERS if (folder / file).exists()]
        if not there:
            raise UsageError(f"the example {name} is not in this installation; install Palpate again")
        found.append(there[0])
    return found


def _first_line(path: Path) -> str:
    """What an example says of itself."""
    if path.is_dir():
        return _C
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        heading = "".join(json.loads(text)["cells"][0]["source"]).splitlines()[0]
        return f"A notebook: {heading.lstrip('# ')}"
    return (ast.get_docstring(ast.parse(text)) or "").splitlines()[0]
