"""What each part of the firmware takes: runs at the prompt of the emulated RP2040 (bench_board.py).

FAST says which loops are tried; SIZES has what cannot be asked here: bytes of the model's body, version and
number of features. Prints lines "part | times | us altogether".
"""

import gc
import time

from firmware_py import memory

memory.reserve()
gc.threshold(32768)
from firmware_py import calib, evaluator, model_image, pipeline, stroke_state, wire  # noqa: E402
from firmware_py.boards import scan_order  # noqa: E402

FAST = False
SIZES = (0, 0, 0)
FRAME = 632
FEW = 8

if FAST:
    from firmware_py import evaluator_viper, hot_viper, stroke_viper
    from firmware_py.boards import fast_link, fast_scan

    for twin in (evaluator_viper, hot_viper, stroke_viper, fast_scan):
        twin.install()
    fast_link.use()


def said(part, times, us):
    print(part, "|", times, "|", us)


def measured(part, times, function, *arguments):
    """Call a function so often, and say what it took."""
    began = time.ticks_us()
    for _ in range(times):
        function(*arguments)
    said(part, times, time.ticks_diff(time.ticks_us(), began))


def watched(part, function):
    """The same function, which says what each call took."""

    def call(*arguments):
        began = time.ticks_us()
        answer = function(*arguments)
        said(part, 1, time.ticks_diff(time.ticks_us(), began))
        return answer

    return call


def link(times):
    """A frame between sensors and wire."""
    packed = bytearray(memoryview(frames.read(FRAME))[8:])
    frames.seek(0)
    raw = bytearray(2 * scan_order.CONVERSIONS)
    places = scan_order.tables()[1]
    measured("into a frame", times, scan_order.pack, memoryview(shorts(raw)), places, packed)
    measured("contact: rows summed", times, stroke_state.row_sums, packed, numbers(16))
    body = bytearray(664)
    body[20:644] = packed
    out = bytearray(wire.wire_size(660))
    measured("crc", times, wire.crc.append, body, 648)
    measured("cobs", times, wire.cobs.encode, body, 652, out, 1)


def shorts(raw):
    """The bytes as numbers of 16 bits."""
    from array import array

    return array("H", raw)


def numbers(n):
    """n numbers of 32 bits."""
    from array import array

    return array("i", bytes(4 * n))


def stroke():
    """All frames of a stroke, then what follows its last one; in plain loops a few frames."""
    c = calib.Calibration()
    with open("calibration", "rb") as file:
        c.load(file.read())
    p = pipeline.Pipeline(c, once=True)
    n = 0
    spent = 0
    one = frames.read(FRAME)
    while len(one) == FRAME and (FAST or n < FEW):
        position = int.from_bytes(one[:3], "little") - 0x800000
        depth = int.from_bytes(one[4:7], "little") - 0x800000
        began = time.ticks_us()
        p.add_frame(one, position, depth, 8)
        spent += time.ticks_diff(time.ticks_us(), began)
        n += 1
        one = frames.read(FRAME)
    said("a frame into its bin", n, spent)
    gc.collect()
    for part in ("_take", "_move", "_find", "_fit", "_choose", "_measure"):
        setattr(p, part, watched("finish" + part, getattr(p, part)))
    body, version, count = SIZES
    with open("model", "rb") as file:

        def read(at, size):
            file.seek(at)
            return file.read(size)

        code, model = model_image.load(read, body, version, count)
    assert code == 0, code
    memory.forget(memory.FLASHING)
    gc.collect()
    if FAST:
        measured("finish", 1, p.finish, model.force_map)
    out = numbers(evaluator.OUT_SIZE)
    measured("evaluator", 1, model.evaluate, p.features, out)


frames = open("frames", "rb")  # noqa: SIM115
link(5 if FAST else 1)
stroke()
