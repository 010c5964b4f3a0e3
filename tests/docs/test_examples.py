"""The examples do what their first lines say; they find the thesis' strokes simulated."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.docs.blocks import DOCS, ROOT

EXAMPLES = DOCS / "examples"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs an example in a directory that all share, once; what it printed and where it ran."""
    place = tmp_path_factory.mktemp("examples")
    shutil.copytree(
        ROOT / "tests" / "host" / "report" / "data", place / "out" / "thesis"
    )  # as a sweep would find them
    said: dict[str, str] = {}

    def run_example(name: str) -> str:
        if name not in said:
            env = os.environ | {"XDG_STATE_HOME": str(place / "state"), "COLUMNS": "160", "NO_COLOR": "1"}
            python = ROOT / ".venv" / "bin" / "python"
            done = subprocess.run(
                [python, EXAMPLES / f"{name}.py"],
                cwd=place,
                env=env,
                capture_output=True,
                text=True,
                timeout=900,
            )
            assert done.returncode == 0, done.stderr
            said[name] = done.stdout
        return said[name]

    run_example.place = place
    return run_example


def numbers(pattern: str, text: str) -> list[float]:
    """The groups of the first match of `pattern`, as numbers."""
    found = re.search(pattern, text)
    assert found, f"{pattern!r} is not in\n{text}"
    return [float(group) for group in found.groups()]


def test_one_stroke_finds_the_bump_and_draws_it(run):
    said = run("one_stroke")
    base, amp, stdev = numbers(r"base ([\d.]+) kPa, amplitude ([\d.]+) kPa, stdev ([\d.]+) mm", said)
    assert base == pytest.approx(3.60, rel=0.02)
    assert amp == pytest.approx(0.58, rel=0.05)
    assert stdev == pytest.approx(4.2, rel=0.05)
    assert (run.place / "out/examples/one_stroke.png").stat().st_size > 10_000


def test_table_1_stands_beside_the_thesis(run):
    said = run("table_1")
    rows = re.findall(r"^ +(\S.*)?p(?:, D)? +\d+ +([\d.]+)(?: \*)? +([\d.]+) ", said, re.MULTILINE)
    assert [name.strip() for name, _, _ in rows if name][:3] == ["F", "t", "d"]
    assert len(rows) == 15, "eight rows from pressure, seven with displacement (the thesis gives none for F)"
    assert all(float(ours) > float(thesis) - 0.01 for _, thesis, ours in rows), rows
    in_sample, left_out, thesis = numbers(r"R2 ([\d.]+) in sample, ([\d.]+) left out, thesis ([\d.]+)", said)
    assert thesis < left_out < in_sample


def test_noise_makes_errors_and_the_intervals_know(run):
    said = run("noise_and_error")
    table = {line.split()[0]: [float(x) for x in line.split()[1:]] for line in said.splitlines()[-4:]}
    force = [table[level][1] for level in ("none", "good", "typical", "poor")]
    assert max(force[:2]) < force[2] < force[3], (
        "better sensors tell the force better, down to the model's own error"
    )
    assert all(row[-1] > 75 for row in table.values()), "intervals at 90 % hold most truths"
    assert all(row[0] > 10 for row in table.values())


def test_the_probe_answers_and_its_recording_replays(run):
    said = run("talk_to_a_probe")
    assert len(re.findall(r"replay of stroke \d: identical", said)) == 3
    assert ", 0 lost" in said
    for diameter in re.findall(r"d ([\d.]+) mm \(", said):
        assert 9 < float(diameter) < 15


def test_integers_agree_with_floats(run):
    said = run("integers_and_floats")
    worst = [float(x) for x in re.findall(r"worst ([\d.e-]+)", said)]
    assert len(worst) == 6
    assert max(worst) < 1e-3
    (largest,) = numbers(r"no intermediate exceeds (\d+)", said)
    assert largest < 2**30


def test_a_recording_becomes_tables(run):
    run("talk_to_a_probe")
    said = run("recording_in_pandas")
    frames, strokes = numbers(r"(\d+) frames, (\d+) strokes, 0 frames lost", said)
    assert strokes == 3
    assert frames >= 150
    force = [float(line.split()[2]) for line in said.splitlines() if re.match(r"[012] ", line)]
    assert len(force) == 3
    assert all(f == pytest.approx(90, rel=0.1) for f in force)


def test_every_example_is_listed_and_tested():
    scripts = {path.stem for path in EXAMPLES.glob("*.py")}
    listed = set(re.findall(r"\((\w+)\.py\)", (EXAMPLES / "index.md").read_text()))
    tested = set(re.findall(r'run\("(\w+)"\)', Path(__file__).read_text()))
    assert scripts == listed == tested
