"""The reference says what the program does: help texts, examples in them, JSON fields."""

import json
import re
import shlex
import subprocess
import sys

import click
import pandas as pd
import pytest
import skops.io
from sklearn.linear_model import Ridge

from palpate.cli import cli
from palpate.link.devices import Device
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.sensors import stroke_frames
from palpate.sim.tissue import Case, simulate
from palpate.wire.events import OUTPUTS
from tests.docs import help_page
from tests.docs.blocks import DOCS, ROOT

PALPATE = ROOT / ".venv" / "bin" / "palpate"


def test_the_help_page_is_what_the_commands_print(tmp_path):
    """In a process of its own: a command that another test has called by itself remembers no `-h`."""
    now = tmp_path / "help.md"
    subprocess.run([sys.executable, "-m", "tests.docs.help_page", now], cwd=ROOT, check=True, timeout=600)
    assert help_page.PAGE.read_text("utf-8") == now.read_text("utf-8"), "run python -m tests.docs.help_page"


@pytest.mark.parametrize("name", help_page.COMMANDS)
def test_every_help_has_an_example_whose_words_are_right(name):
    """Each example line is given to the command's own parser; the documentation's pages run most of them."""
    lines = [line.strip() for line in help_page.help_of(name).splitlines()]
    examples = [re.split(r" {2,}", line)[0] for line in lines if line.startswith("palpate ")]
    assert examples, f"palpate {name} --help shows no example"
    assert any(line.split()[1] == name for line in examples)
    for line in examples:
        words = shlex.split(line.partition(" > ")[0])[1:]
        command = cli.get_command(click.Context(cli), words[0])
        assert command is not None, line
        command.make_context(words[0], words[1:])


def fields_in_the_page(table: str) -> set[str]:
    """The names in the first column of a table of docs/reference/json.md."""
    text = (DOCS / "reference" / "json.md").read_text(encoding="utf-8")
    part = re.search(rf"<!-- fields: {table} -->(.*?)<!-- / -->", text, re.DOTALL)
    assert part, table
    cells = [line.split("|")[1] for line in part[1].splitlines() if line.startswith("| `")]
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """One document of each command, by the name of its table."""
    place = tmp_path_factory.mktemp("json")

    def say(*words, status=0):
        done = subprocess.run(
            [PALPATE, *words, "--json"], cwd=place, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == status, done.stderr
        return json.loads(done.stdout)

    X = pd.DataFrame({"a": [1.0, 2, 3, 4], "b": [2.0, 1, 4, 3]})
    X.to_csv(place / "rows.csv", index=False)
    skops.io.dump(Ridge().fit(X, X["a"] + X["b"]), place / "model.skops")
    (place / "design").write_text("d10h08e10f10\n")
    found = {
        "stroke": say("simulate", "d10h08e10f10"),
        "sweep": say("sweep", "--design", "design", "--out", "sweep"),
        "doctor": say("doctor")[0],
        "compile": say("compile", "model.skops", "--data", "rows.csv", "--out", "model.py"),
    }
    strokes = [stroke_frames(simulate(Case.from_code("d10h08e10f10")), "none", 1)]
    with EmulatedProbe("cpython", strokes, roomy=True) as probe:
        found["stream"] = say("stream", "--port", probe.port, "--strokes", "1", "--record", "a.mcap")
    found["estimate"] = found["stream"]["strokes"][0]
    found["convert"] = say("convert", "a.mcap", "a.parquet")
    found["replay"] = say("replay", "a.mcap", status=1)  # no model was on the probe: nothing to compare
    found["devices"] = Device("COM5", "usb", "a probe").as_dict()
    return found


@pytest.mark.parametrize(
    "table", ["stroke", "sweep", "doctor", "stream", "convert", "replay", "devices", "compile"]
)
def test_the_fields_are_those_in_the_page(table, printed):
    assert set(printed[table]) == fields_in_the_page(table)


def test_an_estimates_fields_are_those_in_the_page(printed):
    """No model is on this probe: the outputs, and what follows from them, are missing; the reason is said."""
    assert set(printed["estimate"]) | {
        *OUTPUTS,
        "depth_mm",
        "depth_from",
        "E_ratio",
        "E_kPa",
    } == fields_in_the_page("estimate")
    assert not printed["estimate"]["valid"]


def test_the_page_of_python_names_what_exists():
    """mkdocstrings reads sources; an object that was renamed would fail only when the site is built."""
    from importlib import import_module

    for name in re.findall(r"^::: (\S+)", (DOCS / "reference" / "python.md").read_text(), re.MULTILINE):
        try:
            import_module(name)
        except ModuleNotFoundError:
            module, _, last = name.rpartition(".")
            assert hasattr(import_module(module), last), name
