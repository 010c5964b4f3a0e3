"""What the link carries, and what it costs the probe: python -m tests.benchmarks.bench_link

Frames a second over a paced 921,600-baud line and over an unpaced pseudo-terminal, with the firmware
under CPython and under MicroPython/WASM; overhead beside what people would write; and microseconds a frame
on the probe.
"""

from __future__ import annotations

import os
import select
import struct
import time

import numpy as np

from firmware_py import geometry, messages, wire
from palpate.sim.probe.emulated import EmulatedProbe
from tests.firmware_py.talk import Ears, command
from tests.micropython import run_micropython

BAUD = 921_600
RATE_MHZ = 10_000_000  # more than any link carries
RUNTIMES = ("cpython", "micropython")


class Still:
    """Frames like those of a stroke through typical sensors: a smooth image and .25 % of full scale noise."""

    def __init__(self, n: int = 60) -> None:
        random = np.random.default_rng(1)
        rows = 800 * np.exp(-(((np.arange(16) - 7.5) / 6) ** 2))
        counts = np.clip(rows[None, :, None] + 82 + random.normal(0, 10, (n, 16, 26)), 0, 4095).astype(
            np.uint32
        )
        pairs = counts.reshape(n, -1)
        whole = pairs[:, 0::2] | pairs[:, 1::2] << 12
        self.packed = [b"".join(int(p).to_bytes(3, "little") for p in frame) for frame in whole]
        self.positions_um = np.linspace(-40_000, 40_000, n).astype(int)
        self.displacements_um = np.full(n, 2500)


def wire_bytes_a_frame(frame: bytes) -> int:
    """Bytes that one frame takes on the wire."""
    body = bytearray(messages.FRAME_BODY + 4)
    messages.put_frame_head(body, 123_456, 789_012_345, -40_000, 2500)
    body[messages.FRAME_HEAD : messages.FRAME_BODY] = frame
    return wire.seal(body, messages.FRAME_BODY, bytearray(700), 0)


def stream(runtime: str, baud: int, seconds: float) -> dict:
    """Stream as fast as it goes for so many seconds; what arrived."""
    with EmulatedProbe(runtime, [Still()], repeat=True, baud=baud) as probe:
        fd = os.open(probe.port, os.O_RDWR | os.O_NOCTTY)
        ears = Ears()

        def listen(duration: float) -> tuple[list, int]:
            got, size = [], 0
            end = time.monotonic() + duration
            while time.monotonic() < end:
                if select.select([fd], [], [], 0.02)[0]:
                    data = os.read(fd, 65536)
                    size += len(data)
                    got += ears.hear(data)
            return got, size

        listen(1.5)
        os.write(fd, command("set_setting", 1, (0, RATE_MHZ)))
        os.write(fd, command("stream_start", 2, (messages.CONTENT_FRAMES, 1, 0, 0)))
        listen(1.0)
        got, size = listen(seconds)
        os.close(fd)
        frames = [m for m in got if m.name == "frame"]
        return {
            "runtime": runtime,
            "link": f"{baud} baud" if baud else "pty, unpaced",
            "frames_per_s": round(len(frames) / seconds, 1),
            "wire_share": round(size / seconds / (baud / 10), 3) if baud else None,
            "bad_packets": ears.receiver.bad_crc + ears.receiver.bad_frame,
        }


def overhead() -> dict:
    """Bytes beyond the data, in per cent of what is on the wire.

    And of a line of text with the same numbers.
    """
    sizes = [wire_bytes_a_frame(f) for f in Still().packed]
    size = float(np.mean(sizes))
    data = geometry.FRAME_BYTES + 12  # counts; position, displacement and time
    line = ",".join(["123456", "789012345", "-40000", "2500", *["882"] * geometry.CELLS]) + "\n"
    unpacked = struct.calcsize(f"<IIii{geometry.CELLS}H") + 2  # with a two-byte start mark, unchecked
    return {
        "bytes_a_frame": size,
        "overhead_percent": round(100 * (size - data) / size, 2),
        "all_but_counts_percent": round(100 * (size - geometry.FRAME_BYTES) / size, 2),
        "text_line_bytes": len(line),
        "struct_bytes": unpacked,
        "frames_per_s_at_921600": round(BAUD / 10 / size, 1),
        "text_frames_per_s_at_921600": round(BAUD / 10 / len(line), 1),
        "struct_frames_per_s_at_921600": round(BAUD / 10 / unpacked, 1),
    }


COSTS = """
import time
from firmware_py import calib, cobs, crc, messages, pipeline, settings, stroke_state
f = open("frames", "rb")
frames = [f.read(624) for _ in range(60)]
body, out = bytearray(645), bytearray(700)

def clock(work, n=300):
    best = 1 << 29
    for _ in range(3):
        t = time.ticks_us()
        for i in range(n):
            work(i % 59)
        best = min(best, time.ticks_diff(time.ticks_us(), t) // n)
    return best

p = pipeline.Pipeline(calib.Calibration())
s = stroke_state.StrokeState(settings.Settings().values)
print(clock(lambda i: crc.append(body, 641)), clock(lambda i: cobs.encode(body, 645, out, 0)),
      clock(lambda i: s.update(frames[i], 1000 * i, 20000 * i)),
      clock(lambda i: p.add_frame(frames[i], 1500 * i, 2500)))
"""


def costs() -> dict:
    """Microseconds a frame in plain bytecode on MicroPython/WASM."""
    said = run_micropython(COSTS, {"frames": b"".join(Still().packed)}).split()
    return dict(zip(PARTS, map(int, said), strict=True))


NAMES = {"cpython": "CPython firmware", "micropython": "MicroPython/WASM firmware"}
PARTS = ("checksum", "stuffing", "watching the stroke", "the pipeline's share of a frame")


def main(seconds: float = 5.0) -> None:
    """Print the tables of docs/protocol.md."""
    size = overhead()
    print("| | 921,600 baud, paced | pseudo-terminal, unpaced |\n|---|---|---|")
    for runtime in RUNTIMES:
        paced, free = stream(runtime, BAUD, seconds), stream(runtime, 0, seconds)
        assert paced["bad_packets"] == free["bad_packets"] == 0
        share = f"{100 * paced['wire_share']:.1f} % of the wire"
        print(
            f"| {NAMES[runtime]} | {paced['frames_per_s']} frames/s, {share} "
            f"| {free['frames_per_s']:.0f} frames/s |"
        )
    print("\n| a frame as | bytes | frames/s at 921,600 baud |\n|---|---|---|")
    print(f"| a packet | {size['bytes_a_frame']:.1f} | {size['frames_per_s_at_921600']:.0f} |")
    print(f"| a line of text | {size['text_line_bytes']} | {size['text_frames_per_s_at_921600']:.0f} |")
    print(f"| an unchecked struct | {size['struct_bytes']} | {size['struct_frames_per_s_at_921600']:.0f} |")
    print(
        f"\noverhead {size['overhead_percent']} %; all but the counts {size['all_but_counts_percent']} %"
        "\n\n| on MicroPython/WASM, plain bytecode | us a frame |\n|---|---|"
    )
    for part, spent_us in costs().items():
        print(f"| {part} | {spent_us} |")


if __name__ == "__main__":
    main()
