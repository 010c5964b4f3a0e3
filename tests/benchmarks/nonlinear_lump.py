"""How the nonlinear lump was chosen, docs/physics.md: python -m tests.benchmarks.nonlinear_lump

Prints, for pairs of stiffness at rest and stiffening, which linear lump each feels like under rising force
(by the strain over the lump), how far its displacement over the lump has gone from that of E = 2 to that of
E = 10 at F = 1, and how much it differs from that of E = 2 at 28 mm.
"""

from __future__ import annotations

from dataclasses import replace

from palpate.sim.tissue import Case, simulate
from tests.sim.tissue.felt import stiffness_felt

REFERENCE = Case.from_code("d10h08e10f10")
FORCES = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
PAIRS = (
    *((2, 300), (2, 500), (2, 600), (1.5, 650)),
    *((1, 300), (1, 600), (1, 850), (1, 900), (1, 1000)),
    *((0.7, 1100), (0.5, 1500), (0.2, 2000)),
)


def main() -> None:
    soft, hard = (simulate(replace(REFERENCE, E_ratio=E)).displacement_mm for E in (2.0, 10.0))
    names = [f"F = {force:g}" for force in FORCES]
    print("| E at rest | b | " + " | ".join(names) + " | share of E = 10 | far, of E = 2 |")
    print("|---" * (len(FORCES) + 4) + "|", flush=True)
    for E, b in PAIRS:
        case = replace(REFERENCE, E_ratio=float(E), lump_stiffening=float(b))
        felt = [f"{value:.1f}" for value in stiffness_felt(case, FORCES)]
        depth = simulate(case).displacement_mm
        share = (soft[-1] - depth[-1]) / (soft[-1] - hard[-1])
        cells = [f"{E:g}", f"{b:g}", *felt, f"{share:.2f}", f"{100 * (depth[0] / soft[0] - 1):+.2f} %"]
        print("| " + " | ".join(cells) + " |", flush=True)
    for E in (10.0, 1000.0):
        far = simulate(replace(REFERENCE, E_ratio=E), positions_mm=[-28.0]).displacement_mm[0]
        print(f"far, of E = 2, the linear lump of E = {E:g}: {100 * (far / soft[0] - 1):+.2f} %")


if __name__ == "__main__":
    main()
