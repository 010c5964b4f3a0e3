"""A stream in rerun: what the command wrote is read back."""

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from palpate import open_recording
from palpate.cli import main
from palpate.link.rerun_log import RerunLog
from palpate.wire.events import Estimate, Frame, TactileMap
from tests.host.sources.arrays import AIR, flexitac, port_of, uniform

RECORDED = Path(__file__).parents[1] / "recording" / "before_the_press.mcap"


def chunks_of(path):
    """Entity -> its rows with times, as columns."""
    found = {}
    for chunk in RrdReader(path).stream():
        if not chunk.is_static:
            for name, column in chunk.to_record_batch().to_pydict().items():
                found.setdefault(str(chunk.entity_path), {}).setdefault(name, []).extend(column)
    return found


def tensor(told):
    """A tensor's numbers."""
    [one] = told
    return np.array(one["buffer"], np.float32).reshape(one["shape"])


def test_a_stream_is_read_back_frame_by_frame(tmp_path, capsys):
    out, kept = tmp_path / "press.rrd", tmp_path / "press.mcap"
    order = ["stream", "--seconds", "2", "--rerun", str(out), "--record", str(kept), "--port"]
    with flexitac([AIR] * 60 + [uniform(5.0)] * 40) as speaker:
        assert main([*order, port_of(speaker)]) == 0
        assert main([*order, port_of(speaker)]) == 1
    assert "exists already" in capsys.readouterr().err
    frames = [event for event in open_recording(kept).events() if isinstance(event, Frame)]
    found = chunks_of(out)
    face = found["/face"]
    assert 0 < len(face["Tensor:data"]) <= len(frames)
    by_time = {frame.time_us: frame for frame in frames}
    for when, told in zip(face["probe"], face["Tensor:data"]):
        microseconds = round(when.total_seconds() * 1e6)
        assert np.array_equal(tensor(told), by_time[microseconds].pressure_kPa)
    newtons = [each[0] for each in found["/motion/force"]["Scalars:scalars"]]
    assert max(newtons) == pytest.approx(max(f.pressure_kPa.sum() for f in frames) * 1.5**2 / 1000, rel=1e-5)
    assert any("a press only" in text[0] for text in found["/log"]["TextLog:text"])


def test_map_estimate_and_layout_are_in_the_file(tmp_path):
    events = list(open_recording(RECORDED).events())
    out = tmp_path / "a.rrd"
    with RerunLog(str(out), False, lambda estimate, told: [estimate.model_id.hex()]) as log:
        for event in events:
            log.push(event)
    found = chunks_of(out)
    maps = [event for event in events if isinstance(event, TactileMap) and event.usable]
    for each, told in zip(maps, found["/map"]["BarChart:values"], strict=True):
        assert tensor(told) == pytest.approx(each.pressure_kPa, rel=1e-6)
    estimates = [event for event in events if isinstance(event, Estimate)]
    assert [[each.model_id.hex()] for each in estimates] == found["/estimate"]["TextDocument:text"]
    reader = RrdReader(out)
    [layout] = reader.blueprints()
    shown = [
        value[0]
        for chunk in reader.stream(store=layout)
        for name, column in chunk.to_record_batch().to_pydict().items()
        if name == "ViewBlueprint:class_identifier"
        for value in column
    ]
    assert sorted(shown) == ["BarChart", "Tensor", "TextDocument", "TextLog", "TimeSeries"]


def test_another_ending_is_refused(capsys):
    assert main(["stream", "--rerun", "press.txt"]) == 2
    assert "--rerun takes FILE.rrd or spawn" in capsys.readouterr().err
