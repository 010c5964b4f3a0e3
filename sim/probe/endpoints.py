"""Where a host connects to an emulated probe: a pseudo-terminal or a TCP port.

Both outlive the host's connections.
"""

import os
import socket
import tty
from typing import Protocol

from palpate.errors import UsageError

QUEUE_BYTES = 16384  # of the kernel's buffers towards the host, so that a slow host has an effect


class Endpoint(Protocol):
    """One place to connect to. `fd` is where the bytes go at the moment, or None if nobody is there."""

    port: str  # what pyserial takes

    @property
    def fd(self) -> int | None: ...
    def waiting(self) -> list[int]: ...  # file descriptors on which a new host may connect
    def accept(self) -> None: ...
    def hang_up(self) -> None: ...
    def close(self) -> None: ...


class PtyEndpoint:
    """A pseudo-terminal. The host sees its other side as a serial port."""

    def __init__(self) -> None:
        self._open()

    def _open(self) -> None:
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

    def hang_up(self) -> None:
        """Unplug: the port vanishes and another, with another name perhaps, takes its place."""
        self.close()
        self._open()

    def close(self) -> None:
        for fd in (self._master, self._slave):
            os.close(fd)


class TcpEndpoint:
    """A listening TCP port that serves one host at a time; the latest to connect is served."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self._listener = socket.create_server((host, port), backlog=1)
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self.port = f"socket://{host}:{self._listener.getsockname()[1]}"

    @property
    def fd(self) -> int | None:
        return self._peer.fileno() if self._peer else None

    def waiting(self) -> list[int]:
        return [self._listener.fileno()]

    def accept(self) -> None:
        self.hang_up()
        try:
            self._peer, _ = self._listener.accept()
        except OSError:
            return
        self._peer.setblocking(False)
        self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUE_BYTES)

    def hang_up(self) -> None:
        """Cut the connection; the host may come back."""
        if self._peer:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        self.hang_up()
        self._listener.close()


def endpoint(listen: str) -> Endpoint:
    """Make the endpoint that `listen` names: "pty" or "tcp:HOST:PORT" (port 0: any). Raises UsageError."""
    if listen == "pty":
        return PtyEndpoint()
    kind, _, where = listen.partition(":")
    host, _, port = where.rpartition(":")
    if kind != "tcp" or not host or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"cannot listen on '{listen}'; say pty or tcp:HOST:PORT")
    return TcpEndpoint(host, int(port))
