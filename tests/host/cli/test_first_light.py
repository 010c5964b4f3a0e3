"""`palpate doctor --port`: a probe with real faults in its cells and its wheel is told what to mend."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from firmware_py import geometry
from palpate import first_light
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.over_lump import strokes_over
from palpate.wire.events import Frame
from palpate.wire.packing import pack
from tests.host.probes import LUMP

FRAMES = 600


@dataclass
class Still:
    """Frames of a probe that lies still, with these faults."""

    packed: list[bytes]
    positions_um: np.ndarray
    displacements_um: np.ndarray


def probe_with(faults, positions_um=None):
    random = np.random.default_rng(5)
    counts = geometry.PEDESTAL_COUNTS + random.normal(0, 3, (FRAMES, geometry.ROWS, geometry.COLUMNS))
    faults(counts)
    packed = [pack(frame.clip(0, geometry.FULL_COUNT).round().astype(int).reshape(-1)) for frame in counts]
    if positions_um is None:
        positions_um = np.zeros(FRAMES, int)
    return EmulatedProbe("cpython", [Still(packed, positions_um, positions_um // 20)], repeat=True)


def states(palpate, port, *more):
    code, out, err = palpate("doctor", "--port", port, "--json", *more)
    return {finding["name"]: finding for finding in json.loads(out)}, code, err


def nothing(counts):
    pass


def a_row_and_a_cell(counts):
    counts[:, 3, :] = 0
    counts[:, 7, 9] = 77
    counts[:, 8, 8] += 900


@pytest.mark.timeout(120)
def test_a_sound_probe_has_nothing_to_mend(palpate):
    with probe_with(nothing) as emulated:
        found, code, _ = states(palpate, emulated.port)
    assert set(found) == {"frames", "contact", "rails", "dead cells", "noise", "zeros"}
    late = found.pop("frames")["state"] == "broken"  # on a busy machine
    assert {f["state"] for f in found.values()} == {"ok"}, found
    assert code == late


@pytest.mark.timeout(120)
def test_a_broken_wire_a_dead_cell_and_a_dirty_one_are_named(palpate):
    with probe_with(a_row_and_a_cell) as emulated:
        found, code, err = states(palpate, emulated.port)
    assert code == 1
    assert "rails, dead cells, zeros; the lines above say what to do" in err
    assert "all of row 3: look at that wire first" in found["rails"]["todo"]
    assert "row 7 column 9" in found["dead cells"]["found"]
    assert "row 8 column 8" in found["zeros"]["found"]


@pytest.mark.timeout(120)
def test_an_emulated_probe_that_nobody_touches_has_its_sensors_noise_and_its_dead_cells(palpate):
    """A hand stroked with it whoever looked, and doctor called that noise and odd zeros."""
    streams, calibration = strokes_over(LUMP, "typical", 2, 50, 1, still=True)
    with EmulatedProbe("cpython", streams, repeat=True, calibration=calibration) as emulated:
        found, code, _ = states(palpate, emulated.port)
    dead = calibration.dead_cells()
    assert dead and found["rails"]["found"].startswith(f"{dead} cells at a rail")
    assert {found[name]["state"] for name in ("dead cells", "noise", "zeros")} == {"ok"}, found
    assert code == 1


@pytest.mark.timeout(120)
def test_a_probe_that_is_being_stroked_is_told_so_and_not_called_noisy(palpate):
    """It was sent to look at the reference's capacitor."""
    with EmulatedProbe("cpython", strokes_over(LUMP, "typical", 2, 50, 1)[0], repeat=True) as emulated:
        found, code, _ = states(palpate, emulated.port)
    assert code == 1
    assert found["contact"]["state"] == "broken" and "something pressed" in found["contact"]["found"]
    assert "ask again" in found["contact"]["todo"]
    assert not {"noise", "zeros"} & set(found)


def test_common_noise_is_noise_and_no_contact():
    """A bad reference moves all cells at once, from frame to frame."""
    random = np.random.default_rng(7)
    counts = 200 + np.repeat(random.normal(0, 60, 100), 416).reshape(100, 16, 26)
    assert first_light.contact(counts, np.zeros(100)).state == "ok"
    assert {f.name: f.state for f in first_light.cells(counts)}["noise"] == "broken"


def frames_apart(*times_us):
    return [Frame(time_us, k, time_us, 0, 0, b"") for k, time_us in enumerate(times_us)]


@pytest.mark.parametrize(
    ("frames", "late", "dropped", "todo"),
    [
        (frames_apart(*range(0, 400_000, 20_000)), 0, 0, ""),
        (frames_apart(*range(0, 800_000, 40_000)), 20, 0, "palpate settings frame_rate 22500"),
        (frames_apart(*range(0, 400_000, 20_000)), 0, 3, "look at the cable"),
        ([], 0, 0, "look at the cable"),
    ],
)
def test_a_rate_that_is_not_kept_and_frames_that_are_lost_are_told(frames, late, dropped, todo):
    (finding,) = first_light.rate(frames, 50.0, late, dropped)
    assert (finding.state == "ok") == (not todo)
    assert todo in finding.todo


WAY = 50_000 * np.sin(np.linspace(0, np.pi, 500)) // 25 * 25


@pytest.mark.parametrize(
    ("way_um", "word"),
    [
        (WAY, ""),
        (-WAY, "backwards"),
        (0 * WAY, "not seen"),
        (0.8 * WAY, "multiply ENCODER_UM by 1.25"),
        (np.concatenate([WAY[:250], WAY[250:] + 400]), "missed"),
    ],
)
def test_the_wheel_is_judged_by_a_push_along_a_ruler_and_back(way_um, word):
    finding = first_light.encoder(way_um.astype(int), 50.0)
    assert word in finding.todo
    assert (finding.state == "ok") == (not word)


def test_noise_that_no_model_was_made_for_is_told():
    random = np.random.default_rng(1)
    counts = 500 + random.normal(0, 40, (50, geometry.ROWS, geometry.COLUMNS))
    noise = {finding.name: finding for finding in first_light.cells(counts)}["noise"]
    assert noise.state == "broken"
    assert noise.found.startswith("40") or noise.found.startswith("39")


def test_push_without_a_port_is_refused(palpate):
    code, _, err = palpate("doctor", "--push", "50")
    assert code == 2
    assert "--push needs --port" in err
