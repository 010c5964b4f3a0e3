"""What the host takes in, and how late it is: python -m tests.benchmarks.bench_host

Ingest on one core: parse alone, parse and decode, parse and decode and record, and playing the recording
back; beside what people write first (struct on fixed lengths; readline and a CSV file). Then, through a real
pseudo-terminal and socket with the firmware on CPython and MicroPython/WASM: the time from the stroke's last
frame to the estimate in the program's hands.
"""

from __future__ import annotations

import csv
import io
import os
import pty
import statistics
import struct
import tempfile
import time
import tty
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from firmware_py import geometry
from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.recording.convert import convert
from palpate.recording.playback import open_recording
from palpate.recording.writer import RecordingWriter
from palpate.wire.events import Estimate, Frame
from palpate.wire.parser import LiveParser
from tests.host.link import wires

N = 20_000
CHUNK = 4096
LIFE = 100.0
"""Frames a second of a usual probe, to say how many times faster than life a recording replays."""


def wire_of(n: int) -> bytes:
    rng = np.random.default_rng(1)
    return wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(n))


def rate(work: Callable[[], int]) -> float:
    """Frames per CPU second: on a shared machine wall time says little."""
    began = time.process_time()
    done = work()
    return done / (time.process_time() - began)


def chunks(data: bytes):
    return (data[at : at + CHUNK] for at in range(0, len(data), CHUNK))


def parse(data: bytes) -> int:
    parser = LiveParser()
    return sum(isinstance(e, Frame) for piece in chunks(data) for e in parser.feed(piece, 1))


def parse_and_decode(data: bytes) -> int:
    parser, done = LiveParser(), 0
    for piece in chunks(data):
        for event in parser.feed(piece, 1):
            if isinstance(event, Frame):
                assert event.pressure_kPa.shape == (16, 26)
                done += 1
    return done


def parse_decode_and_record(data: bytes, path: Path) -> int:
    parser, writer = LiveParser(), RecordingWriter(path, overwrite=True)
    for piece in chunks(data):
        now = time.time_ns()
        for event in parser.feed(piece, now):
            writer.received(parser.raw, event, now)
    writer.close(seal=False)
    return writer.frames


def play(path: Path) -> int:
    with open_recording(path) as probe:
        return sum(isinstance(e, Frame) for e in probe.events())


def fixed_struct(n: int) -> tuple[bytes, Callable[[], int]]:
    """The quick way people write: fixed header, 16-bit counts, CRC; one lost byte and it is out of step."""
    head = struct.Struct("<HIIii")
    body = head.pack(0xA55A, 1, 2, 3, 4) + np.arange(416, dtype="<u2").tobytes()
    packet = body + struct.pack("<I", zlib.crc32(body))
    data = packet * n

    def work() -> int:
        done, size = 0, len(packet)
        stream = io.BytesIO(data)
        while len(piece := stream.read(size)) == size:
            magic, *_ = head.unpack_from(piece)
            assert magic == 0xA55A and zlib.crc32(piece[:-4]) == struct.unpack_from("<I", piece, size - 4)[0]
            assert np.frombuffer(piece, "<u2", 416, head.size).reshape(16, 26).shape == (16, 26)
            done += 1
        return done

    return packet, work


def text_lines(n: int, path: Path) -> tuple[bytes, Callable[[], int]]:
    """The usual way: a line of numbers a frame, `readline`, `split`, a CSV file."""
    text = (",".join(str(v) for v in (1, 2, 3, 4, *range(1000, 1416))) + "\n").encode()
    data = text * n

    def work() -> int:
        done = 0
        stream = io.BytesIO(data)
        with path.open("w", newline="") as out:
            writer = csv.writer(out)
            while piece := stream.readline():
                row = [int(word) for word in piece.split(b",")]
                writer.writerow(row)
                done += 1
        return done

    return text, work


def through_a_terminal(data: bytes) -> int:
    """The same bytes through a real pseudo-terminal, written by another process."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    transport, parser, done = open_transport(os.ttyname(theirs)), LiveParser(), 0
    child = os.fork()
    if child == 0:
        view = memoryview(data)
        while view:
            view = view[os.write(ours, view[:CHUNK]) :]
        os._exit(0)
    while done < N and (piece := transport.read(2.0)):
        done += sum(isinstance(e, Frame) for e in parser.feed(piece, 1))
    os.waitpid(child, 0)
    transport.close()
    for fd in (ours, theirs):
        os.close(fd)
    return done


def latency(runtime: str, listen: str, strokes: int = 5) -> None:
    from palpate.sim.probe.emulated import EmulatedProbe
    from palpate.sim.probe.over_lump import strokes_over

    streams, _ = strokes_over("d12h07e20f09", press=False)
    waits = []
    frames: dict[int, int] = {}
    with (
        EmulatedProbe(runtime, streams, listen, repeat=True) as device,
        Probe(open_transport(device.port)) as probe,
    ):
        probe.set_setting("frame_rate", 100_000)
        for event in probe.stream(strokes=strokes, timeout_s=30):
            if isinstance(event, Frame):
                frames[event.seq] = event.host_ns
            elif isinstance(event, Estimate):
                last = event.first_seq + event.frames - 1  # the probe lifts a frame later
                waits.append((event.host_ns - frames[last]) / 1e6)
    print(
        f"  {runtime:12} {listen.split(':')[0]:4} from last frame to estimate, at 100 frames/s: "
        f"median {statistics.median(waits):6.1f} ms, longest {max(waits):6.1f} ms ({len(waits)} strokes)"
    )


def row(what: str, per_s: float, more: str = "") -> None:
    print(f"| {what} | {per_s:,.0f} | {more} |", flush=True)


def main() -> None:
    """Print the table of docs/performance.md, and the latencies."""
    data = wire_of(N)
    with tempfile.TemporaryDirectory() as folder:
        path, wire_bytes = Path(folder) / "bench.mcap", len(wires.frame(1000))
        print(f"frames of {geometry.CELLS} cells per CPU second on one core\n")
        print("| | frames/s | |\n|---|---|---|")
        parsed = rate(lambda: parse(data))
        row("parse (COBS, CRC-32, sequence numbers)", parsed, f"{wire_bytes} bytes a frame on the wire")
        row("parse, from a pseudo-terminal", rate(lambda: through_a_terminal(data)))
        row("parse, decode to kPa", rate(lambda: parse_and_decode(data)))
        recorded = rate(lambda: parse_decode_and_record(data, path))
        on_disk = f"target: over 5000; {path.stat().st_size / N / 1000:.1f} kB a frame on disk"
        row("parse, decode, record", recorded, on_disk)
        again = rate(lambda: play(path))
        row("play a recording back", again, f"{again / LIFE:.0f} times life at {LIFE:g} frames/s")
        row(
            "convert to Parquet",
            rate(lambda: convert(path, Path(folder) / "bench.parquet", overwrite=True).frames),
        )
        packet, work = fixed_struct(N)
        row(
            "beside: fixed struct, no resynchronising", rate(work), f"{len(packet)} bytes a frame on the wire"
        )
        text, work = text_lines(N // 10, Path(folder) / "bench.csv")
        row("beside: text lines, `readline`, CSV", rate(work), f"{len(text)} bytes a frame on the wire")
    print()
    for runtime, listen in (("cpython", "pty"), ("micropython", "pty"), ("micropython", "tcp:127.0.0.1:0")):
        latency(runtime, listen)


if __name__ == "__main__":
    main()
