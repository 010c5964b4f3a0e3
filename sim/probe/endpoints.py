"""Where a host connects to an emulated probe: a pseudo-terminal or a TCP port.

Both outlive the host's connections.
"""

import contextlib
import os
import socket
import time
from typing import Protocol

from firmware_py import messages, wire
from palpate.errors import UsageError

QUEUE_BYTES = 16384  # of the kernel's buffers towards the host, so that a slow host has an effect


PATIENCE_S = 0.3
BUSY = "another program is connected, and it serves one at a time"


class Endpoint(Protocol):
    """One place to connect to. `fd` is where the bytes go at the moment, or None if nobody is there."""

    port: str  # what pyserial takes

    @property
    def fd(self) -> int | None: ...
    def waiting(self) -> list[int]: ...  # file descriptors on which a new host may connect
    def accept(self) -> None: ...
    def look_after(self) -> None: ...  # from time to time
    def hang_up(self) -> None: ...
    def close(self) -> None: ...


class PtyEndpoint:
    """A pseudo-terminal. The host sees its other side as a serial port."""

    def __init__(self) -> None:
        self._open()

    def _open(self) -> None:
        try:
            import tty
        except ImportError as error:
            raise UsageError(
                "this system has no pseudo-terminals; emulate with --listen tcp:127.0.0.1:7624"
            ) from error
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)

    @property
    def fd(self) -> int | None:
        return self._master

    def waiting(self) -> list[int]:
        return []

    def accept(self) -> None:
        """A terminal has no connections to accept."""

    def look_after(self) -> None:
        """Nor does anybody wait for it."""

    def hang_up(self) -> None:
        """Unplug: the port vanishes and another, with another name perhaps, takes its place."""
        self.close()
        self._open()

    def close(self) -> None:
        for fd in (self._master, self._slave):
            os.close(fd)


class TcpEndpoint:
    """A listening TCP port that serves one host at a time.

    Who comes while another is served waits for a moment, as the other may just be going; then he is told.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self._listener = socket.create_server((host, port), backlog=1)
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self._next: socket.socket | None = None
        self._refuse_at = 0.0
        self.port = f"socket://{host}:{self._listener.getsockname()[1]}"

    @property
    def fd(self) -> int | None:
        return self._peer.fileno() if self._peer else None

    def waiting(self) -> list[int]:
        return [] if self._next else [self._listener.fileno()]

    def accept(self) -> None:
        try:
            new, _ = self._listener.accept()
        except OSError:
            return
        new.setblocking(False)
        new.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        new.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUE_BYTES)
        new.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)  # one whose machine has gone is noticed
        self._next, self._refuse_at = new, time.monotonic() + PATIENCE_S
        self.look_after()

    def look_after(self) -> None:
        """Serve who waits where nobody else is served any more; tell him so where somebody is."""
        if self._next is None:
            return
        if self._peer is None:
            self._peer, self._next = self._next, None
        elif time.monotonic() > self._refuse_at:
            with contextlib.suppress(OSError):
                self._next.send(_log(BUSY))
            self._next.close()
            self._next = None

    def hang_up(self) -> None:
        """Cut the connection; the host may come back."""
        if self._peer:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        self.hang_up()
        if self._next:
            self._next.close()
        self._listener.close()


def _log(text: str) -> bytes:
    """A line of the probe's log on the wire."""
    body, packet = bytearray(256), bytearray(300)
    length = messages.pack(body, messages.TYPE["log"], 0, 0, (messages.LOG_ERROR, 0), text.encode())
    return bytes(packet[: wire.seal(body, length, packet, 0)])


def endpoint(listen: str) -> Endpoint:
    """Make the endpoint that `listen` names: "pty" or "tcp:HOST:PORT" (port 0: any). Raises UsageError."""
    if listen == "pty":
        return PtyEndpoint()
    kind, _, where = listen.partition(":")
    host, _, port = where.rpartition(":")
    if kind != "tcp" or not host or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"cannot listen on '{listen}'; say pty or tcp:HOST:PORT")
    return TcpEndpoint(host, int(port))
