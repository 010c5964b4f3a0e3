"""ReSkin on a pseudo-terminal, read by its package and by us: python -m tests.host.sources.skin OUT.mcap"""

import json
import sys

import numpy as np
from reskin_sensor import ReSkinBase

from palpate.link.session import recorded
from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources.emulated import FIELD_UT, UT_A_KPA, Speaker, as_reskin
from palpate.wire.cells import SHAPE
from palpate.wire.events import Frame, Log

PRESSED = np.full(SHAPE, 2.0)


def theirs():
    with Speaker(PtyEndpoint(), as_reskin, [PRESSED]) as speaker:
        sensor = ReSkinBase(num_mags=5, port=speaker.port, temp_filtered=True)
        field = sensor.get_data(1)[0].data
        sensor.close()
    return field


def ours(out):
    said, kPa = "", []
    with (
        Speaker(PtyEndpoint(), as_reskin, [0 * PRESSED] * 60 + [PRESSED] * 60) as speaker,
        recorded(f"reskin:{speaker.port}", out) as probe,
    ):
        for event in probe.stream(timeout_s=60):
            if isinstance(event, Log):
                said += event.text
            elif isinstance(event, Frame):
                kPa.append(float(event.pressure_kPa.mean()))
                if len(kPa) > 20 and kPa[-1] > 1:
                    break
    return said, max(kPa)


if __name__ == "__main__":
    sent = np.tile(FIELD_UT + 2 * np.array([0.1, 0.2, -UT_A_KPA]), 5)
    felt = theirs()
    said, kPa = ours(sys.argv[1])
    told = {"sent": sent.tolist(), "theirs": felt.tolist(), "ours_kPa": kPa, "said": said}
    print("\n" + json.dumps(told))
