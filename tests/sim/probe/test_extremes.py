"""Every number of every command at its extremes, told to real MicroPython: it answers and goes on."""

import json
import random

import pytest

from firmware_py import messages, status
from palpate.sim.probe.emulated import EmulatedProbe
from tests.benchmarks.bench_link import Still
from tests.firmware_py import c_header
from tests.firmware_py.talk import command
from tests.sim.probe.test_emulated import Host

BITS = {"B": 8, "H": 16, "I": 32, "i": 32}
NAMES = [name for _, name, *_ in messages.COMMANDS]


def fields_of(name):
    return c_header.fields_of(messages.TABLE[messages.TYPE[name]][2])


def extremes(field):
    """The least and greatest value, and those around the limits of a 32-bit interpreter's small numbers."""
    if field.endswith("s"):
        n = int(field[:-1])
        return [bytes(n), b"\xff" * n]
    bits = BITS[field]
    low, high = (0, 1 << bits) if field.isupper() else (-1 << bits - 1, 1 << bits - 1)
    near = {0, 1, -1, 255, 65535} | {
        sign * (1 << k) + d for k in (15, 29, 30, 31) for d in (-1, 0, 1) for sign in (1, -1)
    }
    return sorted({low, low + 1, high - 1} | {v for v in near if low <= v < high})


def usual(name):
    """Values that the command takes."""
    return {
        "calibrate": [0, 1, 0],
        "stream_start": [2, 1, 0, 0],
        "stroke_ack": [1, 1, 7],
        "set_setting": [7, 500],
    }.get(name, [bytes(int(f[:-1])) if f.endswith("s") else 0 for f in fields_of(name)])


def all_extremes():
    """Each field in turn at each of its extremes, the others as usual; then all at once."""
    for name in NAMES:
        fields = fields_of(name)
        for i, field in enumerate(fields):
            for value in extremes(field):
                yield name, [*usual(name)[:i], value, *usual(name)[i + 1 :]]
        if fields:
            yield name, [extremes(f)[0] for f in fields]
            yield name, [extremes(f)[-1] for f in fields]


def tail_of(name, k):
    return bytes([k % 251 + 1]) * (k % (messages.FLASH_PIECE + 1)) if name == "flash_data" else b""


class Asker:
    """A host that resets the frame rate after each question, so that no calibration takes an hour."""

    def __init__(self, probe, host):
        self.probe, self.host, self.number, self.codes = probe, host, 0, {}

    def ask(self, name, values, k=0):
        self.number = self.number % 65535 + 1
        number = self.number
        self.host.write(command(name, number, values, tail_of(name, k)))
        answer = self.host.listen(lambda m: m.kind & messages.ANSWER and m.number == number)
        assert answer.kind == messages.TYPE[name] | messages.ANSWER, (name, values)
        assert answer.code == status.OK or answer.code in status.TEXT, (name, values)
        self.codes[answer.code] = self.codes.get(answer.code, 0) + 1
        if name == "set_setting" and answer.code == status.OK:
            usual = messages.SETTINGS[values[0]][5]
            if values[1] != usual:
                self.ask("set_setting", (values[0], usual))
        if name == "stream_start":
            self.ask("stream_stop", ())
        assert self.probe.running, (name, values)
        assert not self.probe.complaints, (name, values, self.probe.complaints)
        return answer


@pytest.fixture
def asker(public_key):
    with EmulatedProbe("micropython", [Still()], public_key=public_key) as probe, Host(probe) as host:
        yield Asker(probe, host)


def test_every_field_of_every_command_at_its_extremes(asker):
    """`read_back` at 2^31 and beyond was an OverflowError, or the end of the interpreter."""
    for k, (name, values) in enumerate(all_extremes()):
        answer = asker.ask(name, values, k)
        big = [v for v in values if isinstance(v, int) and abs(v) >= messages.WRAP]
        if big and name != "identify":
            assert answer.code == status.BAD_VALUE, (name, values)
    print(json.dumps({"commands": sum(asker.codes.values()), "by status": dict(sorted(asker.codes.items()))}))
    assert asker.ask("identify", (7,)).fields["nonce"] == 7
    assert not [m for m in asker.host.heard if m.name == "log"]


@pytest.mark.long
def test_ten_thousand_random_commands_of_extremes(asker):
    rng = random.Random(5)
    for _ in range(10_000):
        name = rng.choice(NAMES)
        values = [rng.choice([rng.choice(extremes(f)), u]) for f, u in zip(fields_of(name), usual(name))]
        if name == "calibrate":
            values[1] = min(values[1], 3)
        asker.ask(name, values, rng.randrange(1000))
        asker.host.heard.clear()
    print(json.dumps({"commands": sum(asker.codes.values()), "by status": dict(sorted(asker.codes.items()))}))
    assert asker.ask("identify", (7,)).fields["nonce"] == 7
