"""A model signed, flashed and succeeded under another scheme: python -m tests.another_signature DIRECTORY

A test runs it in a copy of the sources that has the scheme. Prints the lengths of a key and a
signature, and the codes of five flashes, as JSON.
"""

import json
import sys
from pathlib import Path

from firmware_py import signature
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from palpate.sim.probe.flash_sim import FlashSim
from tests.model_export import synthetic
from tests.model_export.flashing import flash, probe_of


def main(directory):
    old, new, model = directory / "old", directory / "new", synthetic.model("thesis")
    public = keys.generate(old)
    image, _ = export(model, old, counter=1)
    keys.generate(new, succeeds=old)
    younger, _ = export(model, new, counter=2)
    probe = probe_of(FlashSim(), public)
    changed = image[:100] + bytes([image[100] ^ 1]) + image[101:]
    succession = (new / keys.SUCCESSION).read_bytes()
    flashed = [flash(probe, data) for data in (changed, image, younger, succession, younger)]
    print(json.dumps({"key": len(public), "signature": signature.size(public), "flashed": flashed}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
