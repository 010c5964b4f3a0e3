"""A probe, or somebody's array, shaped as LeRobot's sensors are: connect, read, async_read, disconnect.

LeRobot itself is not imported. Without hardware: `palpate emulate CODE`, and its port.
"""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CommandTimeout, LinkError, UsageError
from palpate.link.probe import Probe
from palpate.wire.cells import SHAPE
from palpate.wire.events import Frame

Image = NDArray[np.float32]


class TactileSensor:
    """Images in kPa of shape (rows, columns), float32.

    Parameters
    ----------
    port : str
        As `palpate stream --port` takes it.
    """

    def __init__(self, port: str = "auto") -> None:
        self.port = port
        self._probe: Probe | None = None
        self._thread: threading.Thread | None = None
        self._come = threading.Condition()
        self._newest: Image | None = None
        self._failure: LinkError | None = None

    @property
    def features(self) -> dict[str, dict[str, Any]]:
        """What a dataset is told of the images."""
        return {"tactile": {"dtype": "float32", "shape": SHAPE, "names": ["along", "across"]}}

    @property
    def is_connected(self) -> bool:
        """True between `connect` and `disconnect`."""
        return self._probe is not None

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.disconnect()

    def connect(self) -> None:
        """Open the port and start the stream. Raises LinkError, or UsageError where it is connected."""
        if self._probe is not None:
            raise UsageError("the sensor is connected already; disconnect it first")
        self._failure = self._newest = None
        self._probe = Probe.open(self.port)
        self._probe.start_stream()
        self._thread = threading.Thread(target=self._follow, args=(self._probe,), daemon=True)
        self._thread.start()

    def read(self, timeout_ms: float = 5000.0) -> Image:
        """The next image to come. Raises CommandTimeout, LinkError."""
        with self._come:
            self._newest = None
            return self._take(timeout_ms)

    def async_read(self, timeout_ms: float = 200.0) -> Image:
        """The newest image not read yet, or the next one. Raises CommandTimeout, LinkError."""
        with self._come:
            return self._take(timeout_ms)

    def disconnect(self) -> None:
        """Stop the stream and give the port back; harmless when repeated."""
        probe, self._probe = self._probe, None
        if probe is not None and self._thread is not None:
            self._thread.join()
            probe.close()

    def _take(self, timeout_ms: float) -> Image:
        if self._probe is None:
            raise UsageError("the sensor is not connected; call connect() first")
        self._come.wait_for(lambda: self._newest is not None or self._failure, timeout_ms / 1000)
        if self._newest is None:
            if self._failure is not None:
                raise self._failure
            raise CommandTimeout(f"no image from {self.port} within {timeout_ms:g} ms")
        image, self._newest = self._newest, None
        return image

    def _follow(self, probe: Probe) -> None:
        try:
            while self._probe is probe:
                for event in probe.events(timeout_s=0.1):
                    if isinstance(event, Frame):
                        with self._come:
                            self._newest = event.pressure_kPa.copy()
                            self._come.notify_all()
                    if self._probe is not probe:
                        break
            if probe.connected:
                probe.stop_stream()
        except LinkError as error:
            with self._come:
                self._failure = error
                self._come.notify_all()
