"""The debug port of an emulated board: stop it, look into its memory, write there, let it go on.

What a programmer's probe does over two pins of a real board, QEMU offers over a socket in GDB's remote serial
protocol: `$text#sum` and an acknowledging `+`; "m" reads memory, "M" writes it, "c" continues, byte 3 stops.
"""

import socket

_PIECE = 1024  # bytes in one packet


class DebugPort:
    """The port of a stopped board, over a connected socket. Raises ConnectionError if it breaks off."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection
        self._heard = b""
        self._ask(b"?")

    def close(self) -> None:
        """Let go of the board."""
        self._socket.close()

    def _send(self, text: bytes) -> None:
        self._socket.sendall(b"$%s#%02x" % (text, sum(text) & 255))

    def _receive(self) -> bytes:
        while True:
            start = self._heard.find(b"$")
            end = self._heard.find(b"#", start + 1)
            if 0 <= start < end and len(self._heard) >= end + 3:
                text = self._heard[start + 1 : end]
                self._heard = self._heard[end + 3 :]
                self._socket.sendall(b"+")
                return text
            data = self._socket.recv(65536)
            if not data:
                raise ConnectionError("the board's debug port was closed")
            self._heard += data

    def _ask(self, text: bytes) -> bytes:
        self._send(text)
        return self._receive()

    def go(self) -> None:
        """Let it run."""
        self._send(b"c")

    def stop(self) -> None:
        """Stop it wherever it is."""
        self._socket.sendall(b"\x03")
        self._receive()

    def read(self, address: int, n: int) -> bytes:
        """n bytes of its memory."""
        out = b""
        while len(out) < n:
            out += bytes.fromhex(
                self._ask(b"m%x,%x" % (address + len(out), min(n - len(out), _PIECE))).decode()
            )
        return out

    def write(self, address: int, data: bytes) -> None:
        """Into its memory, flash too."""
        for at in range(0, len(data), _PIECE):
            piece = data[at : at + _PIECE]
            said = self._ask(b"M%x,%x:%s" % (address + at, len(piece), piece.hex().encode()))
            if said != b"OK":
                raise ConnectionError(f"the board's memory at {address:#x} cannot be written")
