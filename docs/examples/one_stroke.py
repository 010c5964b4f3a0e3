"""One stroke over one lump: simulate it, put its images together, fit the bump, look at it.

    python one_stroke.py [CODE] [PICTURE]

The first thing to change is the case: d, h, E and F, or the fat's stiffness, or the probe's radius.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from palpate.features.map_features import fit_gaussian, stroke_features, tactile_map
from palpate.sim.tissue import Case, Settings, simulate

code = sys.argv[1] if len(sys.argv) > 1 else "d12h07e20f09"
picture = Path(sys.argv[2] if len(sys.argv) > 2 else "out/examples/one_stroke.png")

case = Case.from_code(code)  # or Case(d_mm=12, h=0.7, E_ratio=20, F_rel=0.9, probe_radius_mm=60)
stroke = simulate(case, Settings(hx_mm=2.0))  # a finer mesh: hx_mm=1.0

# Method 2 of the thesis: every place on the tissue gets the mean of all readings taken there.
x_mm, pressure_kPa = tactile_map(stroke, method=2)
bump = fit_gaussian(x_mm, pressure_kPa, centre_mm=0.0)
found = stroke_features(stroke)

print(f"{stroke.code}: a lump {case.d_mm:g} mm wide under {case.depth_mm:g} mm of fat, E = {case.E_ratio:g}")
print(f"base {bump.base_kPa:.2f} kPa, amplitude {bump.amp_kPa:.3f} kPa, stdev {bump.stdev_mm:.2f} mm")
print(f"displacement {found.D28_mm:.2f} mm far from the lump, {found.D0_mm:.2f} mm over it")
print(
    f"amplitude {100 * bump.amp_kPa / bump.base_kPa:.1f} % of base, fit to {1000 * bump.rms_kPa:.0f} Pa rms"
)

figure = Figure(figsize=(9, 3.4), layout="constrained")
left, right = figure.subplots(1, 2)
extent = (stroke.sensors_mm[0], stroke.sensors_mm[-1], stroke.positions_mm[-1], stroke.positions_mm[0])
shown = left.imshow(stroke.images_kPa, extent=extent, aspect="auto", cmap="cividis")
figure.colorbar(shown, ax=left, label="pressure, kPa")
left.set(xlabel="sensor, mm", ylabel="probe's position, mm", title="tactile images")
right.plot(x_mm, pressure_kPa, "o", ms=3, label="tactile map")
right.plot(x_mm, bump.curve(x_mm), label="base and Gaussian")
right.set(xlabel="place on the tissue, mm", ylabel="pressure, kPa", title=stroke.code)
right.legend(frameon=False)
picture.parent.mkdir(parents=True, exist_ok=True)
figure.savefig(picture, dpi=120)
print(f"wrote {picture}")
