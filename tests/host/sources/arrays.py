"""Arrays of others on a pseudo-terminal, and what they feel."""

import numpy as np

from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources.emulated import Speaker, as_flexitac
from palpate.wire.cells import SHAPE

AIR = np.zeros(SHAPE)


def uniform(kPa):
    """One pressure everywhere."""
    return np.full(SHAPE, float(kPa))


def flexitac(images, **more):
    """A FlexiTac of our own array's shape: the speaker."""
    return Speaker(PtyEndpoint(), as_flexitac, images, **more)


def port_of(speaker, **options):
    """What `--port` takes of it."""
    told = "".join(f"&{name}={value}" for name, value in options.items())
    return f"flexitac:{speaker.port}?rows={SHAPE[0]}&cols={SHAPE[1]}&pitch=1.5{told}"
