"""The layout file for Foxglove shows what is in a recording, and nothing that is not."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from palpate.link.session import recorded
from palpate.recording.channels import SCHEMAS
from palpate.recording.reader import Recording

LAYOUT = json.loads((Path(__file__).parents[3] / "docs" / "foxglove" / "palpate.json").read_text())
PANELS = LAYOUT["configById"]


def paths_in(value: Any) -> Iterator[str]:
    """Every message path of the layout: strings that begin with a topic."""
    if isinstance(value, dict):
        for item in value.values():
            yield from paths_in(item)
    elif isinstance(value, list):
        for item in value:
            yield from paths_in(item)
    elif isinstance(value, str) and value.startswith("/"):
        yield value


def panels_in(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels_in(layout["first"])
        yield from panels_in(layout["second"])


PATHS = sorted(set(paths_in(PANELS)))


@pytest.fixture(scope="module")
def messages(bench, public_key, images, tmp_path_factory):
    """The last message of each topic of one recorded stroke."""
    from palpate.link.flash import flash
    from palpate.link.probe import Probe
    from palpate.sim.probe.emulated import EmulatedProbe

    path = tmp_path_factory.mktemp("foxglove") / "stroke.mcap"
    strokes, calibration = bench
    words = {"public_key": public_key, "calibration": calibration, "roomy": True}
    with EmulatedProbe("cpython", strokes, **words) as made:
        with Probe.open(made.port) as client:
            flash(client, images[0])
        with recorded(made.port, path) as client:
            for _ in client.stream(strokes=1, timeout_s=60):
                pass
    return {topic: record.data for topic, record in Recording(path).records() if topic in SCHEMAS}


@pytest.mark.parametrize("path", PATHS)
def test_every_path_of_the_layout_is_a_field_of_a_recording(messages, path):
    topic, *field = re.sub(r"\[:\]", "", path).split(".")
    assert topic in SCHEMAS
    if topic == "/log":
        return  # the probe writes into it only when something is wrong
    shown = json.loads(messages[topic])
    for name in field:
        assert name in SCHEMAS[topic][1]
        shown = shown[name]
    assert shown not in (None, [])


def test_every_panel_has_its_settings_and_a_place():
    assert sorted(panels_in(LAYOUT["layout"])) == sorted(PANELS)
    assert {path.split(".")[0] for path in PATHS} >= {
        "/image",
        "/motion",
        "/map",
        "/estimate",
        "/stroke",
        "/log",
    }
