"""The demo, as a newcomer runs it: the whole chain on real MicroPython, and an answer that can be checked."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PALPATE = Path(sys.executable).with_name("palpate")


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Run from a directory of one's own, into one named relatively: outside the clone it found no store."""
    elsewhere = tmp_path_factory.mktemp("demo")
    out = elsewhere / "here" / "out"
    run = subprocess.run(
        [PALPATE, "demo", "--out", Path("here") / "out", "--json"],
        cwd=elsewhere,
        capture_output=True,
        text=True,
        timeout=800,
        env={**os.environ, "COLUMNS": "80"},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout), run.stderr, out


def test_the_probe_says_what_the_host_replays(demo):
    result, _, _ = demo
    assert result["replay_identical"] is True
    assert result["estimate"]["model_id"] == result["model_id"]


def test_the_estimate_is_near_the_truth(demo):
    """No model has met this ball; every true value lies in its 90 % interval."""
    result, _, _ = demo
    assert result["estimate"]["lump"]
    for name, share in (("F_N_per_m", 0.05), ("t_mm", 0.15), ("d_mm", 0.25), ("h", 0.3)):
        said = result["estimate"][name]
        assert said["value"] == pytest.approx(result["truth"][name], rel=share), name
        assert said["low"] <= result["truth"][name] <= said["high"], name
    for name in ("width_mm", "place_mm"):
        said = result["across"][name]
        assert said["low"] <= result["truth"][name] <= said["high"], name


def test_the_report_begins_with_what_the_strokes_say_together(demo):
    """The pooled estimate with its interval, which holds the truth and is no wider than one stroke's."""
    result, _, out = demo
    together = result["together"]
    assert together["strokes"] + together["left_out"] == 3 and together["strokes"] >= 2
    for name in ("d_mm", "depth_mm", "t_mm", "width_mm"):
        low, truth, high = together[name]["low"], result["truth"][name], together[name]["high"]
        assert low <= truth <= high, name
    one = result["estimate"]["d_mm"]
    assert together["d_mm"]["high"] - together["d_mm"]["low"] <= 1.05 * (one["high"] - one["low"])
    page = (out / "report" / "index.html").read_text("utf-8")
    headline = re.search(r"<h1>(.*?)</h1>", page)[1]
    assert headline.startswith(
        "A lump of {value:.1f} mm ({low:.1f} to {high:.1f})".format(**together["d_mm"])
    )
    assert page.index("random effects") < page.index('id="figure_2"')


def test_it_leaves_the_picture_the_recording_and_the_image(demo):
    result, _, out = demo
    for name in ("picture", "recording", "image", "model"):
        assert (out.parent.parent / result["files"][name]).stat().st_size > 1000
    assert (out / "demo.png").read_bytes().startswith(b"\x89PNG")
    assert result["image_bytes"] == (out / "model.palp").stat().st_size


def test_the_recording_replays_identically_from_the_command_line(demo):
    _, _, out = demo
    run = subprocess.run(
        [PALPATE, "replay", out / "stroke.mcap"], capture_output=True, text=True, timeout=300, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "identical" in run.stdout
