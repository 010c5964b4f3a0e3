"""A small model of every output, on the emulated probe: python -m tests.another_output DIRECTORY

A test runs it in a copy of the sources whose table of outputs has another row. Prints what a stroke was
answered, what is shown of it, and the truth, as JSON.
"""

import json
import sys
from pathlib import Path

from palpate.answer.card import card
from palpate.cli import ports
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from tests import another_array
from tests.firmware_py.strokes import read_strokes


def main(directory):
    pairs = read_strokes()
    fields = [StrokeField(*pair) for pair in pairs[:-1]]
    spec = another_array.trained(fields, another_array.learned_force_map(pairs))
    key = directory / "key"
    keys.generate(key)
    image, _ = export(spec, key)
    model = SensorModel(fields[1], LEVELS["good"], 7)
    stroke = model.stroke(another_array.FRAMES)
    public = (key / "public.key").read_bytes()
    found, _ = another_array.answer(image, public, "micropython", stroke, model.calibration())
    said = {
        "estimate": found.as_dict(),
        "lines": ports.estimate_lines(found),
        "rows": card(found)["rows"],
        "truth": stroke.truth.outputs(),
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
