"""What the tests' probes feel, and clients that talk to them."""

from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.sim.probe.emulated import EmulatedProbe
from tests.waiting import wait_until

LUMP = "d12h07e20f09"
FRAMES = 40


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
