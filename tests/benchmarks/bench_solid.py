"""How long a stroke over a solid lump takes: python -m tests.benchmarks.bench_solid [--peer]

One process, one thread, CPU seconds, set-up of a fresh geometry included; medians of rounds taken by turns
with ten partial factorisations: the elements near the probe at each position. What the system takes is for
memory that it clears. With --peer the ball on the line in felupe (PyPI) instead, between two strokes of ours.
"""

from __future__ import annotations

import os
import resource
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from palpate.sim.tissue import Case, Settings, Stroke, simulate
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.solid.element import elasticity
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from palpate.sim.tissue.solid.newton import near_probe
from palpate.sim.tissue.solid.run import Body, set_up
from palpate.sim.tissue.solid.stroke import forget_geometry, simulate_forces

CASES = (("on the line", "d10h08e10f07_ball"), ("5 mm beside it", "d10h08e10f07_ball_y5"))
ROUNDS = 5


class Factorisations:
    """One at each position of a stroke, of the elements near the probe."""

    def __init__(self, case: Case, settings: Settings) -> None:
        self.positions = settings.solid_positions_mm()
        geometry = set_up(lay_grid(case, settings, self.positions[0], self.positions[-1]))
        mesh = geometry.mesh
        body = Body(mesh, geometry.integrals, elasticity(case, mesh, geometry.integrals))
        count = len(mesh.elements)
        K = np.zeros((count, 81, 81), np.float32)
        rest = np.zeros(3 * len(mesh.nodes_mm)), np.zeros((count, 4))
        body.tangent(*rest, np.arange(count), K, np.zeros((count, 4, 81)))
        self.fill = lambda which, into: np.copyto(into, K[which])
        self.near = [near_probe(mesh, x) for x in self.positions]
        self.solver = Multifrontal(geometry.fronts, self.near)
        self.solver.factor(self.fill)

    def cpu_s(self) -> float:
        began = time.process_time()
        with one_blas_thread():
            for near in self.near:
                self.solver.change_elements(near)
                self.solver.factor(self.fill)
        return time.process_time() - began


def peer() -> None:
    """The same stroke in felupe, on the same mesh cut into hexahedra of eight nodes."""
    from tests.benchmarks.peers import felupe_solid

    case, settings = Case.from_code(CASES[0][1]), Settings()
    positions = [float(x) for x in settings.solid_positions_mm()]

    def ours() -> Stroke:
        forget_geometry()
        return simulate(case, settings)

    ours()
    before = ours()
    with one_blas_thread():
        theirs = felupe_solid.run(case, settings, positions)
    s = ours()
    cpu = (before.cpu_s + s.cpu_s) / 2
    depth = np.abs(theirs.displacement_mm / s.displacement_mm - 1).max()
    rms = (np.sqrt(np.mean((theirs.images_kPa - s.images_kPa) ** 2, axis=(1, 2))) / s.peak_kPa).max()
    print(f"{case.code}, {len(positions)} positions\n")
    print("| program | nodes | solutions | CPU s | times ours | displacement | pressure |\n|" + "---|" * 7)
    print(f"| Palpate | {s.nodes:,} | {s.iterations.sum()} | {cpu:.1f} | 1 | | |")
    print(
        f"| {theirs.name} | {theirs.nodes:,} | {theirs.iterations} | {theirs.cpu_s:.1f} | "
        f"{theirs.cpu_s / cpu:.0f} | {100 * depth:.2f} % | {100 * rms:.1f} % |"
    )
    print(
        "displacement (largest difference, 1 % allowed) and pressure (rms over the sensors, of the peak, 3 %"
    )
    print("allowed) against ours")


def main() -> None:
    if "--peer" in sys.argv:
        peer()
        return
    heads = (
        "lump",
        "a stroke",
        "of it the system's",
        "each of two forces, with a press-in ramp",
        "ten partial factorisations",
    )
    print("| " + " | ".join((*heads, "stroke / these", "nodes", "factorisations", "iterations")) + " |")
    print("|---" * (len(heads) + 4) + "|", flush=True)
    # first, since a process begins with the most that its parent has had
    fresh = ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1)
    memory = list(fresh.map(most_MB, (code for _, code in CASES)))
    for words, code in CASES:
        case, settings = Case.from_code(code), Settings()
        simulate(case, settings)
        apart = Factorisations(case, settings)
        alone, cleared, together, bare = [], [], [], []
        for _ in range(ROUNDS):
            forget_geometry()
            before = os.times().system
            stroke = simulate(case, settings)
            cleared.append(os.times().system - before)
            alone.append(stroke.cpu_s)
            forget_geometry()
            two = simulate_forces(case, [case.F_rel / 1.4, case.F_rel], settings, ramp=True)
            together.append(two[0].cpu_s)
            bare.append(apart.cpu_s())
        a, of_it, b, c = map(statistics.median, (alone, cleared, together, bare))
        cells = (f"{a:.1f}", f"{of_it:.1f}", f"{b:.1f}", f"{c:.1f}", f"{a / c:.1f}", f"{stroke.nodes:,}")
        counts = (str(stroke.factorisations), str(stroke.iterations.sum()))
        print("| " + " | ".join((f"`{code}`, {words}", *cells, *counts)) + " |", flush=True)
    for (words, _), most in zip(CASES, memory, strict=True):
        print(f"\na process that computes the one {words} takes {most:.0f} MB at most")


def most_MB(code: str) -> float:
    """The most memory that this process has had, with a stroke computed in it."""
    simulate(Case.from_code(code), Settings())
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
