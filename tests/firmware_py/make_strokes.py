"""Simulates the strokes that the pipeline's tests look at: python -m tests.firmware_py.make_strokes

They are kept in strokes.npz so that these tests wait for no solver, which tests/sim/tissue checks.
"""

import math
from pathlib import Path

import numpy as np

from palpate.sim.probe.sensors import FORCE_RATIO
from palpate.sim.tissue import Case, Settings, simulate_forces

FILE = Path(__file__).parent / "strokes.npz"
PAIRS = 10


def cases():
    """Lumps spread over what the field model is trained on, all of them detectable; last, a place without."""
    rng = np.random.default_rng(7)
    for _ in range(PAIRS):
        d, h = float(rng.uniform(6, 20)), float(rng.uniform(0.3, 1.1))
        yield Case(
            d, h, float(rng.choice([3, 6, 10, 30, 300])), float(rng.uniform(0.35, 1)) / math.sqrt(FORCE_RATIO)
        )
    yield Case.without_lump(20.0, 0.6)


def main():
    settings = Settings(far_start_mm=-44)
    codes, images, depths = [], [], []
    for case in cases():
        for stroke in simulate_forces(case, [case.F_rel, FORCE_RATIO * case.F_rel], settings):
            codes.append(stroke.code)
            images.append(stroke.images_kPa)
            depths.append(stroke.displacement_mm)
            positions = stroke.positions_mm
            print(stroke.code, flush=True)
    np.savez_compressed(
        FILE, codes=codes, positions_mm=positions, images_kPa=np.float32(images), depths_mm=np.float32(depths)
    )


if __name__ == "__main__":
    main()
