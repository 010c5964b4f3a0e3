"""The reference board's parts that need no board: link to USB, order of measuring, what is installed."""

import sys
import types
from itertools import pairwise

from firmware_py.boards import scan_order
from tests.firmware_py import install_files


def test_every_cell_is_measured_once_and_one_address_pin_changes_at_a_time_along_a_row():
    steps = list(scan_order.walk())
    assert sorted(cell for _, _, cell in steps if cell >= 0) == list(range(416))
    assert [channel for channel, _, cell in steps if cell < 0] == [scan_order.DISPLACEMENT] * 2
    for (_, before, _), (_, now, _) in pairwise(steps):
        rows, columns = (before ^ now) & 15, (before ^ now) >> 4
        assert rows.bit_count() <= 1
        assert columns.bit_count() <= 1


def test_the_usb_link_takes_only_what_it_can_and_never_waits(monkeypatch):
    monkeypatch.setitem(sys.modules, "machine", types.SimpleNamespace(UART=None))
    monkeypatch.setitem(sys.modules, "micropython", types.SimpleNamespace())
    from firmware_py.boards import links

    link = links.UsbLink.__new__(links.UsbLink)
    arrived, taken = bytearray(b"\x03\x04hello"), bytearray()

    class Stream:
        def readinto(self, one):
            one[0] = arrived.pop(0)
            return 1

        def write(self, buffer, offset, length):
            n = min(length, 10)
            taken.extend(buffer[offset : offset + n])
            return n

    class Poll:
        def __init__(self, ready):
            self.ready = ready

        def ipoll(self, timeout):
            assert timeout == 0
            return iter([None] if self.ready() else [])

    link._in = link._out = Stream()
    link._readable, link._writable = Poll(lambda: arrived), Poll(lambda: len(taken) < 25)
    link._byte = bytearray(1)
    buffer = bytearray(64)
    assert link.read(buffer) == 7
    assert buffer[:7] == b"\x03\x04hello"
    assert link.read(buffer) == 0
    sent = bytearray(range(100))
    at = 0
    while n := link.write(sent, at, 100):
        at += n
    assert taken == sent[:at]
    assert at == 30


def test_the_list_for_mip_names_every_module():
    assert install_files.PACKAGE.read_text() == install_files.text(), (
        "run: python -m tests.firmware_py.install_files"
    )


def test_the_state_machines_words_are_those_of_the_walk():
    steps = list(scan_order.walk())
    addresses = [address for _, address, _ in steps[1:]] + [0]
    orders, places = scan_order.tables()
    assert list(orders) == [
        scan_order.order(channel, here, following)
        for (channel, here, _), following in zip(steps, addresses, strict=True)
    ]
    assert all(places[cell] == n for n, (_, _, cell) in enumerate(steps) if cell >= 0)
