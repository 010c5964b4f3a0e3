"""The emulated probe: the firmware in an interpreter of its own, on a pseudo-terminal or a TCP port."""

import contextlib
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import firmware_py
from firmware_py import calib, safe_record, sensor_array, status
from firmware_py.store import FileStore
from palpate.errors import PalpateError, UsageError
from palpate.sim.probe import node, source
from palpate.sim.probe.faults import Faults
from palpate.sim.probe.preloaded import preload
from palpate.sim.probe.relay import Relay

if TYPE_CHECKING:
    from palpate.sim.tissue import Case

FIRMWARE = Path(firmware_py.__file__).parent
DEVICE = Path(__file__).parent / "device"
RUNTIMES = ("micropython", "cpython")
RP2040 = "rp2040"
"""A runtime as well: the reference board, its processor emulated (palpate.sim.probe.rp2040)."""
START_S, BOARD_START_S = 120.0, 1200.0
"""How long an interpreter may take to come up, however busy this machine is, and an emulated board."""
_HEAP = 512 * 1024
_CLOSE_QUEUE, _ROOMY_QUEUE = 4096, 1 << 20
"""Bytes asked of the kernel for what waits for the relay; it gives some 300 frames' room at most."""


class EmulatorFailed(PalpateError):
    """The process that runs the firmware did not start."""


class EmulatedProbe:
    """A probe without hardware. Use it as a context manager, or `start` and `stop` it.

    Parameters
    runtime: "micropython" (the real interpreter, WASM under Node) or "cpython"; "rp2040" is the reference
        board (MicroPython's own port on an emulated RP2040, far slower than a real one)
    strokes: what the sensors read once a stream starts: strokes one after the other
        (palpate.sim.probe.sensors.FrameStream)
    listen: "pty", or "tcp:HOST:PORT" (port 0: any)
    store: directory that keeps model, calibration and settings over restarts; None: a new one, removed
        at the end
    repeat: begin again with the first stroke after the last
    calibration: what the probe left the bench with (sensors.SensorModel.calibration); default:
        nominal
    public_key: the public key whose models the probe accepts
    to_host, to_device, seed, baud: a bad or slow link, see palpate.sim.probe.relay.Relay
    roomy: seconds of frames wait for a host that is held up, as in the buffers of a USB port; without it a
        host that does not read is felt after a tenth of a second
    model: a signed image that is live when it is first switched on; it takes a public key

    Attributes: port (what pyserial takes), complaints (lines the firmware wrote to its error output),
    times_slower (seconds here that one of its own takes: 1, or, measured while it started, an emulated
    board's; hosts learn it from the note that `palpate.link.emulated.leave` leaves).
    """

    def __init__(
        self,
        runtime: str = "micropython",
        strokes: Iterable[source.FramedStroke] = (),
        listen: str = "pty",
        store: Path | None = None,
        repeat: bool = False,
        public_key: bytes | None = None,
        calibration: calib.Calibration | None = None,
        serial: bytes = b"EMULATED",
        to_host: Faults | None = None,
        to_device: Faults | None = None,
        seed: int = 0,
        baud: int = 0,
        roomy: bool = False,
        model: bytes | None = None,
    ) -> None:
        if runtime not in (*RUNTIMES, RP2040):
            raise UsageError(f"there is no runtime '{runtime}'; there are {', '.join((*RUNTIMES, RP2040))}")
        self._uf2: Path | None = None
        node.check_runtime(runtime)
        if runtime == RP2040:
            from palpate.sim.probe.rp2040 import interpreter

            self._uf2 = interpreter.find()
        self.runtime = runtime
        self.complaints: list[str] = []
        self.times_slower = 1.0
        self._dir = Path(tempfile.mkdtemp(prefix="palpate-probe-"))
        self._store = store.resolve() if store else self._dir / "store"
        self._store.mkdir(parents=True, exist_ok=True)
        if calibration:
            safe_record.Record(FileStore(str(self._store)), "cal").save(calibration.to_bytes())
        if model is not None and public_key is not None:
            preload(FileStore(str(self._store)), public_key, model)
        self._repeat = repeat
        self._serial = serial
        self._public_key = public_key
        between = source.LIFTED_AS_BY_HAND if runtime == RP2040 else source.LIFTED
        self._source = source.write_source(self._dir / "source-0", strokes, between)
        self._sources = 1
        self._ours, self._theirs = socket.socketpair()
        for end in (self._ours, self._theirs):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOMY_QUEUE if roomy else _CLOSE_QUEUE)
        self._ours.setblocking(False)
        self._theirs.setblocking(False)
        self.relay = Relay(self._ours.fileno(), listen, to_host, to_device, seed, baud)
        self._process: subprocess.Popen[bytes] | None = None
        self._orders: int | None = None
        self._reader: threading.Thread | None = None

    @classmethod
    def over(
        cls,
        case: "Case | str",
        noise: str = "typical",
        seed: int = 1,
        strokes: int = 1,
        frames: int = 50,
        runtime: str = "cpython",
        **options: Any,
    ) -> "EmulatedProbe":
        """A probe that a hand presses and strokes over a lump, in as many different strokes as you like.

        case, noise, seed, strokes, frames: see `palpate.sim.probe.over_lump.strokes_over`
        options: see the class
        """
        from palpate.sim.probe.over_lump import strokes_over

        streams, calibration = strokes_over(case, noise, seed, frames, strokes)
        return cls(runtime, streams, calibration=calibration, **options)

    @property
    def port(self) -> str:
        """What a host opens: a path, or socket://HOST:PORT."""
        return self.relay.port

    @property
    def store(self) -> Path:
        """The directory that is the probe's flash memory."""
        return self._store

    @property
    def running(self) -> bool:
        """False before the start, and after a power cut."""
        return self._process is not None and self._process.poll() is None

    def _boots(self) -> int:
        """Count this start, in a file beside the probe's own."""
        counter = self._store / "boots"
        try:
            boots = int(counter.read_text()) + 1
        except (OSError, ValueError):  # the first start, or a file that a power cut has left in pieces
            boots = 1
        counter.write_text(str(boots))
        return boots

    def start(self, power_bytes: int | None = None) -> "EmulatedProbe":
        """Switch on, and wait until the firmware listens (or has ended).

        power_bytes: cut the power when so many more bytes have been written to the store. Raises
        EmulatorFailed where the interpreter does not come up.
        """
        if self.running:
            return self
        orders, self._orders = os.pipe()
        os.set_blocking(orders, False)
        listens, listens_in = os.pipe()
        config = {
            "orders": orders,
            "listens": listens_in,
            "firmware": str(FIRMWARE),
            "array": str(sensor_array.__file__),
            "record": source.RECORD_BYTES,
            "programs": [str(DEVICE / "emulated_board.py"), str(DEVICE / "main.py")],
            "main": "main",
            "heap": _HEAP,
            "store": str(self._store),
            "store_error": status.STORE_ERROR,
            "source": str(self._source),
            "repeat": self._repeat,
            "serial": list(self._serial),
            "public_key": list(self._public_key) if self._public_key else None,
            "boots": self._boots(),
            "power_bytes": power_bytes,
            "uf2": str(self._uf2),
        }
        path = self._dir / "config.json"
        path.write_text(json.dumps(config))
        if self.runtime == "micropython":
            command = [node.node(), str(node.WASM / "device.mjs"), str(path)]
        elif self.runtime == RP2040:
            command = [sys.executable, "-P", "-m", "palpate.sim.probe.rp2040", str(path)]
        else:
            command = [sys.executable, "-P", "-m", "palpate.sim.probe.device", str(path)]
        errors, errors_in = os.pipe()
        self._process = subprocess.Popen(
            command,
            stdin=self._theirs.fileno(),
            stdout=self._theirs.fileno(),
            stderr=errors_in,
            pass_fds=(orders, listens_in),
        )
        for theirs in (errors_in, orders, listens_in):
            os.close(theirs)
        self._reader = threading.Thread(target=self._listen, args=(errors,), daemon=True)
        self._reader.start()
        try:
            limit_s = BOARD_START_S if self.runtime == RP2040 else START_S
            if not select.select([listens], [], [], limit_s)[0]:
                self.cut_power()
                raise EmulatorFailed(f"the emulated probe did not come up within {limit_s:g} s; try again")
            said = os.read(listens, 64)
            if said and self.runtime == RP2040:
                self.times_slower = max(1.0, float(said))
        finally:
            os.close(listens)
        return self

    def _listen(self, fd: int) -> None:
        with os.fdopen(fd, "r", errors="replace") as stream:
            for line in stream:
                self.complaints.append(line.rstrip())

    def _order(self, text: str) -> None:
        if self._orders is not None:
            os.write(self._orders, text.encode() + b"\n")

    def set_strokes(self, strokes: Iterable[source.FramedStroke], lifted: int = source.LIFTED) -> None:
        """What the sensors read from the next stream on; `lifted` frames in the air around each stroke."""
        self._source = source.write_source(self._dir / f"source-{self._sources}", strokes, lifted)
        self._sources += 1
        if self.running:
            self._order(f"source {self._source}")

    def cut_power(self) -> None:
        """Switch off abruptly; `start` switches on again."""
        if self._process:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGKILL)
            self._process.wait(10)
        if self._reader:
            self._reader.join(5)
        if self._orders is not None:
            os.close(self._orders)
        self._process = self._orders = None
        with contextlib.suppress(BlockingIOError):
            while self._ours.recv(65536):
                pass

    def cut_power_after(self, store_bytes: int) -> None:
        """Cut the power when so many more bytes have been written to the store.

        In the middle of the write.
        """
        self._order(f"power {store_bytes}")

    def unplug(self) -> None:
        """Cut the connection; the probe keeps running, and a host may connect again."""
        self.relay.cut()

    def stop(self) -> None:
        """Switch off and clean up; harmless when repeated."""
        if self._ours.fileno() < 0:
            return
        self.cut_power()
        self.relay.close()
        self._ours.close()
        self._theirs.close()
        shutil.rmtree(self._dir, ignore_errors=True)

    def __enter__(self) -> "EmulatedProbe":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()
