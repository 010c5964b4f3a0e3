"""How far a reader goes to follow four calls: python -m tests.rooms --trips

Each function is read once, when the call first enters it. Printed are the modules opened, their rooms, and
the returns: changes to a module that was open before. What worker processes run is not counted.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import palpate
from palpate import models
from palpate.learn.data import prepare_strokes
from palpate.model_export.signing import keys
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.stroke.answered import Answered
from palpate.view.live import LiveSource
from palpate.view.session import Session
from palpate.wire.events import Frame
from tests.rooms import room_of

STROKES = Path(__file__).parent / "host" / "learn" / "data"
LUMPS = 9
OURS = ("palpate", "firmware_py")
OTHER_END = ("palpate.sim.probe.emulated", "palpate.sim.probe.relay")


class Trip:
    """Functions of ours in the order in which they are entered first, here and on threads begun meanwhile."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget what was entered so far."""
        self._known: set[CodeType] = set()
        self.modules: list[str] = []

    def take(self, call: Callable[[], object]) -> Trip:
        """Follow a call to its end."""
        threading.setprofile(self._entered)
        sys.setprofile(self._entered)
        try:
            call()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]
        return self

    def _entered(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or code in self._known:
            return
        self._known.add(code)
        module = frame.f_globals.get("__name__", "")
        # written for us by `dataclass`, or a module's own body: nobody reads a call there
        written = not code.co_filename.startswith("<") and code.co_name != "<module>"
        ours = module.split(".")[0] in OURS and module not in OTHER_END
        if written and ours and not _imports(frame):
            self.modules.append(module)

    @property
    def returns(self) -> int:
        """Changes to a module that was open before."""
        pairs = zip(self.modules, self.modules[1:])
        return sum(a != b and b in self.modules[: k + 1] for k, (a, b) in enumerate(pairs))


def _imports(frame: FrameType | None) -> bool:
    """Is it entered by a module that is being imported?"""
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") != "__main__":
            return True
        frame = frame.f_back
    return False


def page(key: Path) -> Trip:
    """The frames of a stroke and its answer, from an open port to a page's mailbox."""
    session, stop, trip = Session(mode="live", name="x"), threading.Event(), Trip()
    session.join()
    begun = False

    def emit(event: Any) -> None:
        nonlocal begun
        if isinstance(event, Frame) and not begun:
            trip.begin()  # what opened the port is another trip
            begun = True
        session.on_event(event)
        if isinstance(event, Answered):
            stop.set()

    public, (model, _) = (key / "public.key").read_bytes(), palpate.export(models.load("thesis_tissue"), key)
    with EmulatedProbe.over("d10h08e10f10", repeat=True, public_key=public, model=model) as probe:
        return trip.take(lambda: LiveSource(probe.port).run(emit, stop))


def main() -> None:
    """Take the trips, print a line of each."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        shutil.copytree(STROKES, home / "told")
        prepare_strokes(home / "any", LUMPS, workers=1)
        keys.generate(home / "key")
        spec = models.load("thesis_tissue")
        trips: dict[str, Callable[[], object]] = {
            "fit(directory), told its tissue": lambda: palpate.fit(
                home / "told", "field", tissue={}, workers=1
            ),
            "fit(directory), of any tissue": lambda: palpate.fit(home / "any", "field"),
            "export(spec)": lambda: palpate.export(spec, home / "key"),
        }
        for words, call in trips.items():
            show(words, Trip().take(call))
        show("a stroke from the wire to the page", page(home / "key"))


def show(words: str, trip: Trip) -> None:
    """One line."""
    rooms = {room_of(module) for module in trip.modules} - {None}
    print(
        f"{words}: {len(set(trip.modules))} modules in {len(rooms)} rooms, {trip.returns} returns", flush=True
    )
