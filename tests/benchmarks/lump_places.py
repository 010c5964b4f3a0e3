"""Lumps in the fat, on its border and in the gland, on ever finer meshes, for docs/physics.md: python -m
tests.benchmarks.lump_places

Every size of the mesh is halved with hx; the errors are against hx = .5. Then the border moves off the lump
that it has just touched.
"""

from __future__ import annotations

from palpate.features.map_features import stroke_features
from palpate.sim.tissue import Case, Settings, simulate

PLACES = {
    "in the fat, 9 mm over its border": "d10h06e10f06_g20_t25",
    "in the fat, touching the gland": "d10h06e10f06_g20_t16",
    "cut, three quarters in the fat": "d10h06e10f06_g20_t13.5",
    "through its middle (the thesis' tie)": "d10h06e10f06_g20_t11",
    "cut, three quarters in the gland": "d10h06e10f06_g20_t8.5",
    "in the gland, touching the fat": "d10h06e10f06_g20_t6",
    "in the gland, 4 mm under its border": "d10h08e50f08_g20_t4",
    "2 mm under the skin": "d08h0.25e10f06_g20_t16",
}
NAMES = ("Base, kPa", "Amp/Base", "Stdev, mm", "D28, mm", "dip")
TOUCHING_MM = (6.2, 6.05, 6.02, 6.0, 5.99, 5.98, 5.95, 5.8)


def _features(code: str, times_finer: int = 1) -> list[float]:
    stroke = simulate(Case.from_code(code), Settings().refined(times_finer))
    f = stroke_features(stroke)
    return [f.base_kPa, f.amp_kPa / f.base_kPa, f.stdev_mm, f.D28_mm, 1 - f.D0_mm / f.D28_mm]


def main() -> None:
    print("| lump | code |", " | ".join(NAMES), "| errors at hx = 2 | errors at hx = 1 |")
    print("|---" * (len(NAMES) + 4) + "|", flush=True)
    for words, code in PLACES.items():
        coarse, middle, fine = (_features(code, times) for times in (1, 2, 4))
        errors = (
            ", ".join(f"{100 * (a / b - 1):+.2f}" for a, b in zip(values, fine)) + " %"
            for values in (coarse, middle)
        )
        cells = (f"{value:.4f}" for value in fine)
        print("|", words, f"| `{code}` |", " | ".join(cells), "|", " | ".join(errors), "|", flush=True)
    print("\n| fat over a lump 6 mm deep, mm |", " | ".join(NAMES), "|\n|" + "---|" * (len(NAMES) + 1))
    for fat in TOUCHING_MM:
        cells = (f"{value:.4f}" for value in _features(f"d10h06e10f06_g20_t{fat:g}"))
        print(f"| {fat:g} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
