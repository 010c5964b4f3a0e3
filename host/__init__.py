"""Palpate: one stroke of a tactile probe, one estimate of the lump under it.

The names below are the front door. Each is imported when it is first used: the command line starts at once.

    from palpate import Case, simulate, sweep   # finite-element strokes
    from palpate import fit, export             # a model of them, and its signed image for the probe
    from palpate import EmulatedProbe, Probe    # a probe without hardware, and the client that talks to any
    from palpate import open_recording          # what a probe sent, again
    from palpate import invert                  # its strokes fitted by the finite-element model itself
    from palpate import PalpateError            # root of every error
"""

from __future__ import annotations

import logging
import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.errors import PalpateError
    from palpate.inversion import invert
    from palpate.learn.fit import fit
    from palpate.link.probe import Probe
    from palpate.model_export.exporter import export
    from palpate.recording.playback import open_recording
    from palpate.sim.probe.emulated import EmulatedProbe
    from palpate.sim.tissue import Case, simulate, sweep

__version__ = "0.1.0"

_HOMES = {
    "Case": "palpate.sim.tissue",
    "EmulatedProbe": "palpate.sim.probe.emulated",
    "PalpateError": "palpate.errors",
    "Probe": "palpate.link.probe",
    "export": "palpate.model_export.exporter",
    "fit": "palpate.learn.fit",
    "invert": "palpate.inversion",
    "open_recording": "palpate.recording.playback",
    "simulate": "palpate.sim.tissue",
    "sweep": "palpate.sim.tissue",
}

logging.getLogger(__name__).addHandler(logging.NullHandler())  # who wants to hear adds another

if os.environ.get("PALPATE_ARRAY"):
    import_module("palpate.array").watch()

__all__ = [
    "Case",
    "EmulatedProbe",
    "PalpateError",
    "Probe",
    "export",
    "fit",
    "invert",
    "open_recording",
    "simulate",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
