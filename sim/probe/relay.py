"""A relay between a probe and its host that makes the link as bad as requested."""

import contextlib
import os
import select
import threading
import time

from palpate.sim.probe.endpoints import Endpoint, endpoint
from palpate.sim.probe.faults import Faults, FaultyLine

_CHUNK = 4096
_BACKLOG = 8192  # bytes the relay holds for a host that does not read before it stops reading from the probe


class Relay:
    """Carries bytes between a file descriptor (the probe's side) and an endpoint for the host, in a thread.

    Parameters
    device_fd: non-blocking; stays the caller's
    listen: "pty" or "tcp:HOST:PORT"
    to_host, to_device: the faults of either direction
    seed: of the faults
    baud: bits a second in either direction, ten to a byte (0: as fast as it goes)

    Attributes: port (for the host), to_host and to_device (FaultyLine: what was done to the bytes), cuts.
    """

    def __init__(
        self,
        device_fd: int,
        listen: str = "pty",
        to_host: Faults | None = None,
        to_device: Faults | None = None,
        seed: int = 0,
        baud: int = 0,
    ) -> None:
        self._device = device_fd
        self._host: Endpoint = endpoint(listen)
        self.to_host = FaultyLine(to_host or Faults(), seed)
        self.to_device = FaultyLine(to_device or Faults(), seed + 1)
        self.cuts = 0
        self.bytes_to_host = 0
        self._bytes_per_s = baud / 10
        self._credit_at = time.monotonic()
        self._credit = 0.0
        self._held_for_host = bytearray()
        self._held_for_device = bytearray()
        self._resume = {"host": 0.0, "device": 0.0}
        self._wake_out, self._wake_in = os.pipe()
        self._ending = False
        self._orders: list[str] = []
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)
        self._thread.start()

    @property
    def port(self) -> str:
        """What pyserial takes; changes when a pseudo-terminal is cut."""
        return self._host.port

    def cut(self) -> None:
        """Cut the connection to the host now."""
        self._orders.append("cut")
        os.write(self._wake_in, b"!")

    def close(self) -> None:
        """Stop carrying and close the host's side."""
        self._ending = True
        os.write(self._wake_in, b"!")
        self._thread.join()
        self._host.close()
        os.close(self._wake_in)
        os.close(self._wake_out)

    def _allowance(self) -> int:
        """How many bytes the paced link carries towards the host now."""
        if not self._bytes_per_s:
            return _CHUNK
        now = time.monotonic()
        self._credit = min(self._credit + (now - self._credit_at) * self._bytes_per_s, self._bytes_per_s / 50)
        self._credit_at = now
        return int(self._credit)

    def _cut(self) -> None:
        self.cuts += 1
        self._held_for_host.clear()
        self._held_for_device.clear()
        self._host.hang_up()

    def _run(self) -> None:
        while not self._ending:
            now = time.monotonic()
            self._host.look_after()
            host = self._host.fd
            allowance = self._allowance()
            readable = [self._wake_out, *self._host.waiting()]
            writable = []
            timeout = 0.5
            if len(self._held_for_host) < _BACKLOG and self._resume["host"] <= now:
                readable.append(self._device)
            if host is not None and len(self._held_for_device) < _BACKLOG:
                readable.append(host)
            if host is not None and self._held_for_host:
                if allowance > 0:
                    writable.append(host)
                else:
                    timeout = 0.001
            if self._held_for_device and self._resume["device"] <= now:
                writable.append(self._device)
            if max(self._resume.values()) > now:
                timeout = min(timeout, 0.01)
            can_read, can_write, _ = select.select(readable, writable, [], timeout)
            if self._wake_out in can_read:
                os.read(self._wake_out, 64)
                while self._orders:
                    self._orders.pop()
                    self._cut()
                continue
            if any(fd in can_read for fd in self._host.waiting()):
                if host is None:
                    self._held_for_host.clear()
                    self._held_for_device.clear()
                self._host.accept()
                continue
            if self._device in can_read:
                self._take(self._device, self.to_host, self._held_for_host, "host")
            if (
                host is not None
                and host in can_read
                and not self._take(host, self.to_device, self._held_for_device, "device")
            ):
                self._held_for_host.clear()
                self._held_for_device.clear()
                self._host.hang_up()
                continue
            if host is None:
                self._held_for_host.clear()  # an unplugged cable keeps nothing
            elif host in can_write:
                sent = self._give(host, self._held_for_host, allowance)
                self._credit -= sent
                self.bytes_to_host += sent
            if self._device in can_write:
                self._give(self._device, self._held_for_device, _CHUNK)

    def _take(self, fd: int, line: FaultyLine, held: bytearray, name: str) -> bool:
        """Read from fd and pass it through the line's faults; False once the other end is gone."""
        try:
            data = os.read(fd, _CHUNK)
        except BlockingIOError:
            return True
        except OSError:
            time.sleep(0.001)
            return True  # a pseudo-terminal between two connections
        if not data:
            return False
        held += line.pass_through(data)
        if line.stall_s:
            self._resume[name] = time.monotonic() + line.stall_s
            line.stall_s = 0.0
        if line.cut:
            line.cut = False
            self._cut()
        return True

    @staticmethod
    def _give(fd: int, held: bytearray, most: int) -> int:
        with contextlib.suppress(BlockingIOError, OSError):
            n = os.write(fd, held[:most])
            del held[:n]
            return n
        return 0
