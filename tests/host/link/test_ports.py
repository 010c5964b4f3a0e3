"""Ports that are busy, forbidden, missing, silent or too many: each gets its sentence."""

import os
import pty
import re
import subprocess
import sys
import tty

import pytest

from palpate.errors import PortAmbiguous, PortBusy, PortError, PortForbidden, PortMissing, UsageError
from palpate.link import devices
from palpate.link import emulated as notes
from palpate.link.transport import open_transport

HOLD = (
    "import serial, sys; s = serial.Serial(sys.argv[1], exclusive=True); print('held', flush=True); input()"
)
HOLD_WITHOUT_LOCK = (
    "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('held', flush=True); input()"
)
DEVICE = "import os; _, end = os.openpty(); print(os.ttyname(end), flush=True); input()"


@pytest.fixture
def terminal():
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_a_busy_port_names_the_program_that_holds_it(terminal):
    command = [sys.executable, "-c", HOLD, terminal]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(PortBusy) as caught:
            open_transport(terminal)
        holder.communicate("\n")
    assert f"(process {holder.pid})" in str(caught.value)
    assert "close that program" in str(caught.value)
    open_transport(terminal).close()


@pytest.mark.parametrize("link", [False, True])
def test_a_port_that_a_program_has_open_without_a_lock_is_busy_too(terminal, tmp_path, link):
    """As a terminal program or a modem manager does it: two readers would share the bytes between them."""
    port = terminal
    if link:  # as udev's names under /dev/serial/by-id
        port = str(tmp_path / "by-id")
        os.symlink(terminal, port)
    command = [sys.executable, "-c", HOLD_WITHOUT_LOCK, terminal]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(PortBusy, match="close that program") as caught:
            open_transport(port)
        holder.communicate("\n")
    assert re.search(rf"python[\w.]* \(process {holder.pid}\) holds it", str(caught.value))
    open_transport(port).close()


def test_a_device_that_is_no_terminal_is_not_called_busy():
    with open(os.devnull) as _held, pytest.raises(PortError, match="not a serial port"):
        open_transport(os.devnull)


def test_an_emulated_probe_in_another_process_does_not_hold_its_own_port():
    """The process behind a pseudo-terminal has both of its ends open: it is the device."""
    command = [sys.executable, "-c", DEVICE]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as device:
        port = device.stdout.readline().strip()
        open_transport(port).close()
        device.communicate("\n")


def test_a_forbidden_port_names_the_group_to_join(terminal):
    import grp

    group = grp.getgrgid(os.stat(terminal).st_gid).gr_name
    if os.getuid() == 0:  # root may open anything: become somebody else
        group = "dialout"
        os.chown(terminal, 0, grp.getgrnam(group).gr_gid)
        os.chmod(terminal, 0o660)
        os.seteuid(65534)
    else:
        os.chmod(terminal, 0)
    try:
        with pytest.raises(PortForbidden, match=f"usermod -aG {group}") as caught:
            open_transport(terminal)
    finally:
        os.seteuid(os.getuid())
    assert caught.value.group == group


def test_missing_ports_and_invalid_arguments(tmp_path):
    with pytest.raises(PortMissing, match="plug the probe in"):
        open_transport("/dev/ttyNOTHERE")
    with pytest.raises(PortMissing, match="nothing listens"):
        open_transport("socket://127.0.0.1:1")
    for wrong in ("socket://", "socket://localhost", "socket://localhost:http"):
        with pytest.raises(UsageError, match="socket://HOST:PORT"):
            open_transport(wrong)
    plain = tmp_path / "plain"
    plain.write_text("no port")
    with pytest.raises(Exception, match="not a serial port"):
        open_transport(str(plain))


def test_a_port_that_vanishes_while_it_is_opened_is_missing(terminal, monkeypatch):
    """An error of the terminal's own kind, which is no OSError."""
    import termios

    def gone(*_):
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr(termios, "tcflush", gone)
    with pytest.raises(PortMissing, match="plug the probe in"):
        open_transport(terminal)


def test_auto_finds_the_one_probe_and_will_not_choose_between_two(emulated):
    with pytest.raises(PortMissing, match="palpate emulate"):
        devices.resolve("auto")
    one = emulated(serial=b"SERIAL-1")
    notes.leave(notes.Note(one.port, os.getpid(), "d12h07e20f09", "cpython"))
    assert devices.resolve("auto").port == one.port
    assert devices.resolve(b"SERIAL-1".hex()).port == one.port
    two = emulated()
    notes.leave(notes.Note(two.port, os.getpid(), "d12h07e20f09", "cpython"))
    with pytest.raises(PortAmbiguous, match="--port") as caught:
        devices.resolve("auto")
    assert set(caught.value.candidates) == {one.port, two.port}
    with pytest.raises(PortMissing, match="devices"):
        devices.resolve("NO-SUCH-SERIAL")


def test_notes_of_killed_emulators_are_forgotten():
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    path = notes.leave(notes.Note("/dev/pts/999", gone.pid, "d12h07e20f09", "cpython"))
    assert notes.running() == []
    assert not path.exists()


def test_a_usb_probe_is_found_by_its_serial_number_wherever_it_is_plugged(emulated, monkeypatch):
    from types import SimpleNamespace

    from serial.tools import list_ports

    device = emulated()
    usb = SimpleNamespace(
        device=device.port, vid=0x2E8A, pid=0x0005, serial_number="E660583883", description="Board in FS mode"
    )
    other = SimpleNamespace(device="/dev/ttyS9", vid=None, pid=None, serial_number=None, description="n/a")
    monkeypatch.setattr(list_ports, "comports", lambda: [usb, other])
    place = devices.resolve("e660583883")
    assert (place.port, place.usb_serial) == (device.port, "E660583883")
    assert devices.resolve("auto").port == device.port  # the port of unknown hardware is not even asked
    states = {d.port: d.state for d in devices.find()}
    assert states == {device.port: "probe", "/dev/ttyS9": "not asked"}
    usb.device = "/dev/ttyACM7"
    assert place.port_now() == "/dev/ttyACM7"
    monkeypatch.setattr(list_ports, "comports", lambda: [other])
    with pytest.raises(PortMissing):
        place.port_now()
