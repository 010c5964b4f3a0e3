"""What the tests' probes feel, and clients that talk to them."""

import numpy as np

from palpate.importing.declaration import Declaration
from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.sim.probe.emulated import EmulatedProbe
from tests.waiting import wait_until

LUMP = "d12h07e20f09"
FRAMES = 40
DECLARED = Declaration(
    16, 26, (1.5, 1.5), pressure="kPa", position="x", displacement="z", time="t", stroke="n"
)
"""What `arrays_of` are, to the importer."""


def arrays_of(strokes):
    """Strokes as somebody's own program would keep them: kPa, mm and s, numbered from 1."""
    return {
        "kPa": np.concatenate([s.counts / 4095 * 25 - 0.5 for s in strokes]).reshape(-1, 16, 26),
        "x": np.concatenate([s.positions_um / 1e3 for s in strokes]),
        "z": np.concatenate([s.displacements_um / 1e3 for s in strokes]),
        "t": np.concatenate([s.times_us / 1e6 for s in strokes]),
        "n": np.repeat(np.arange(len(strokes)) + 1, [len(s) for s in strokes]),
    }


def connect(probe: EmulatedProbe, recorder=None) -> Probe:
    """A client that finds the probe again under whatever name its port has."""
    return Probe(open_transport(probe.port), recorder, lambda: open_transport(probe.port))


def settled(probe: Probe) -> dict[str, int]:
    """The probe's counts after the stream's end, once every frame it acquired has come or is counted lost.

    What the stream's end had promised and has not come is counted once the line is quiet.
    """
    told = probe.statistics()

    def all_are_counted():
        return probe.frame_counts.received + probe.frame_counts.lost >= told["frames_acquired"]

    wait_until(all_are_counted, "the last frames, or the count of what is missing")
    assert probe.frame_counts.received + probe.frame_counts.lost == told["frames_acquired"]
    return told
