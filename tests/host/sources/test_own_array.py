"""The how-to's made-up array, as its page has it: found by its entry point and read on a real line."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate import Probe
from palpate.cli import main
from palpate.errors import PortError
from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources.emulated import Speaker
from palpate.wire.cells import SHAPE
from tests.host.sources.arrays import AIR, flexitac, port_of, uniform

PAGE = Path(__file__).parents[3] / "docs" / "howto" / "your-own-array.md"
READ = """
import json, sys
from palpate import Probe
from palpate.wire.events import Frame
with Probe.open(sys.argv[1]) as probe:
    seen = []
    for event in probe.stream(timeout_s=60):
        if isinstance(event, Frame):
            seen.append(float(event.pressure_kPa.mean()))
            if len(seen) > 20 and seen[-1] > 5:
                break
print(json.dumps([min(seen), max(seen)]))
"""


def wire(kPa):
    """As the page's array sends an image."""
    rows = np.rint(kPa / 25 * 1023).astype(int)
    return "".join(["F\n", *("R " + " ".join(map(str, row)) + "\n" for row in rows)]).encode()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """The page's package, installed as pip would: its module and its entry points."""
    monkeypatch.chdir(tmp_path)
    [block] = re.findall(r"```python title=\"my_array.py\"\n(.*?)```", PAGE.read_text(), re.S)
    exec(block, {})
    package = tmp_path / "my-array"
    info = package / "my_array-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-array\nVersion: 1\n")
    entry = re.findall(r"^mine = \"(.*)\"$", (package / "pyproject.toml").read_text(), re.M)[0]
    (info / "entry_points.txt").write_text(f"[palpate.sources]\nmine = {entry}\n")
    return package


def test_a_stranger_adds_an_array_in_one_file(package):
    assert len((package / "my_array.py").read_text().splitlines()) <= 60
    with Speaker(PtyEndpoint(), wire, [AIR] * 60 + [uniform(6.0)] * 60) as speaker:
        port = f"mine:{speaker.port}?rows={SHAPE[0]}&cols={SHAPE[1]}&pitch=1.5mm"
        done = subprocess.run(
            [sys.executable, "-c", READ, port],
            env={**os.environ, "PYTHONPATH": str(package)},
            capture_output=True,
            text=True,
            timeout=300,
        )
    assert done.returncode == 0, done.stderr[-2000:]
    low, high = json.loads(done.stdout)
    assert low == pytest.approx(0.0, abs=0.03) and high == pytest.approx(6.0, abs=0.03)


def test_without_its_package_the_scheme_is_unknown(capsys):
    assert main(["stream", "--port", "mine:/dev/null?rows=16&cols=26&pitch=1.5mm"]) == 2
    assert "nothing here reads 'mine': there are anyskin, flexitac, reskin" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("feed", "said"),
    [
        ("raise KeyError(3)", "its source failed with KeyError: 3"),
        ("return [np.zeros((2, 2))]", "an image of (2, 2)"),
        ("return [np.full((16, 26), np.nan)]", "with 0 finite numbers"),
    ],
)
def test_a_source_that_fails_is_named_in_a_sentence(feed, said, monkeypatch):
    from palpate.sources.flexitac import FlexiTac

    scope = {"np": np}
    exec(f"def feed(self, data):\n    {feed}\n", scope)
    monkeypatch.setattr(FlexiTac, "feed", scope["feed"])
    with flexitac([AIR]) as speaker, pytest.raises(PortError) as refused:
        Probe.open(port_of(speaker))
    assert said in str(refused.value)
