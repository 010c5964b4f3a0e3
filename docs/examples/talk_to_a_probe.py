"""Bring up an emulated probe, put a model on it, stroke a lump, record it, and replay it bit for bit.

    python talk_to_a_probe.py [SWEEP] [RECORDING]

With a real probe everything but the first `with` is the same: give its port to `Probe.open`.
"""

import sys
import tempfile
from pathlib import Path

from palpate.learn.thesis.polynomial import fit_thesis_model
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.session import recorded
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.sensors import LEVELS, stroke_frames
from palpate.sim.tissue import Case, load_strokes, read_design, simulate, sweep
from palpate.stroke.replay import replay
from palpate.wire.events import Estimate, Frame

SEED = 11
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/thesis")
recording = Path(sys.argv[2] if len(sys.argv) > 2 else "out/examples/visit.mcap")

if __name__ == "__main__":  # the sweep's worker processes import this file
    # 1. A model, and a key to sign it with. Real keys are made once and kept: see `palpate keygen --help`.
    sweep(read_design("thesis"), out_dir=directory)
    spec = fit_thesis_model(load_strokes(directory), seed=SEED)
    with tempfile.TemporaryDirectory() as key_directory:
        public_key = keys.generate(key_directory)
        image, report = export(spec, key_directory)
    print(f"model {report.model_id}: {report.size} bytes, {report.proof.headroom_bits:.1f} bits to spare")

    # 2. What the sensors will feel: three strokes over a lump that is not among the thirty.
    truth = Case.from_code("d12h07e20f09")
    stroke = simulate(truth)
    steady_hand = LEVELS["typical"].without("force")
    strokes = [stroke_frames(stroke, steady_hand, SEED + k) for k in range(3)]

    # 3. The probe: real MicroPython behind a pseudo-terminal. Flash it, stroke, record.
    recording.parent.mkdir(parents=True, exist_ok=True)
    with EmulatedProbe("micropython", strokes, public_key=public_key, roomy=True) as emulated:
        with Probe.open(emulated.port) as probe:
            print(f"probe {probe.identity.serial} at {probe.name}: {flash(probe, image).model_id} is live")
        with recorded(emulated.port, recording, overwrite=True) as probe:
            frames = 0
            for event in probe.stream(strokes=3):
                if isinstance(event, Frame):
                    frames += 1
                elif isinstance(event, Estimate):
                    d = event.outputs["d_mm"]
                    words = f"{d['value']:.2f} mm ({d['low']:.2f} to {d['high']:.2f}), lump {event.hardness}"
                    print(f"stroke {event.stroke}: d {words}, truth {truth.d_mm:g} mm")
            print(f"{frames} frames, {probe.frame_counts.lost} lost")

    # 4. The same integers again, on this machine, out of the recording.
    for number, again in enumerate(replay(recording), 1):
        print(f"replay of stroke {number}: {'identical' if again.identical else 'DIFFERENT'}")
    print(f"wrote {recording}")
