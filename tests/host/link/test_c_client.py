"""The C client of docs/examples/c, compiled from the generated header, against the emulated probe."""

import re
import subprocess

import pytest

from palpate.sim.probe.faults import Faults
from palpate.wire.events import Estimate
from palpate.wire.results import OUTPUTS
from tests.firmware_py.protocol_files import HEADER
from tests.host.probes import FRAMES, connect
from tests.waiting import PATIENCE_S

FLAGS = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic"]
CHECKED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    """The program, which ends at the first wrong access or undefined operation."""
    out = tmp_path_factory.mktemp("c") / "client"
    subprocess.run(["gcc", *FLAGS, *CHECKED, "-o", out, HEADER.with_name("client.c")], check=True)

    def run(*words):
        done = subprocess.run([out, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S)
        return done.returncode, done.stdout, done.stderr

    return run


def estimates(out):
    """What it printed of each stroke: name -> value, low, high."""
    found = []
    for line in re.findall(r"^stroke .*$", out, re.M):
        numbers = re.findall(r"(\w+) (-?\d+\.\d+) (-?\d+\.\d+) (-?\d+\.\d+)", line)
        found.append({name: tuple(map(float, values)) for name, *values in numbers})
    return found


def counts(out):
    """Frames, lost, damaged."""
    return [int(n) for n in re.search(r"^frames (\d+) lost (\d+) damaged (\d+)$", out, re.M).groups()]


@pytest.fixture
def image(images, tmp_path):
    path = tmp_path / "model.palp"
    path.write_bytes(images[0])
    return path


@pytest.mark.parametrize(("runtime", "listen"), [("micropython", "tcp:127.0.0.1:0"), ("cpython", "pty")])
def test_it_flashes_streams_and_estimates_as_the_python_client_does(client, emulated, image, runtime, listen):
    device = emulated(runtime, listen=listen)
    status, out, err = client(device.port.removeprefix("socket://"), 2, image)
    assert (status, err) == (0, "")
    assert f"flashed {image.stat().st_size} bytes" in out
    frames, lost, damaged = counts(out)
    assert frames >= 2 * FRAMES
    assert lost == damaged == 0
    said = estimates(out)
    with connect(device) as probe:
        assert probe.identity.has_model
        assert probe.identity.stream == 0, "it was stopped"
        assert probe.statistics()["estimates_given_up"] == 0
        events = list(probe.stream(strokes=2, timeout_s=PATIENCE_S))
    for mine, theirs in zip((e for e in events if isinstance(e, Estimate)), said, strict=True):
        for name in OUTPUTS:
            assert theirs[name] == pytest.approx(tuple(mine.outputs[name].values()), abs=1e-6)


def test_damage_on_the_line_costs_it_frames_and_nothing_else(client, emulated, image):
    faulty = Faults(flip=1e-4, lose=1e-4)
    device = emulated(listen="tcp:127.0.0.1:0", to_host=faulty, to_device=faulty, seed=2, repeat=True)
    status, out, err = client(device.port.removeprefix("socket://"), 3, image)
    assert (status, err) == (0, "")
    assert len(estimates(out)) == 3
    _, lost, damaged = counts(out)
    assert lost > 0
    assert damaged > 0


def test_it_says_in_a_sentence_what_is_wrong(client, emulated, tmp_path):
    nothing = tmp_path / "nothing"
    nothing.write_bytes(b"no image at all" * 2000)
    port = emulated(listen="tcp:127.0.0.1:0").port.removeprefix("socket://")
    status, _, err = client(port, 1, nothing)
    assert status == 1
    assert re.fullmatch(r"client: the probe refuses 0x0[AC]: status -\d+\n", err)
    assert client()[0] == 2
    assert client("127.0.0.1:1", 1)[0] == 1
