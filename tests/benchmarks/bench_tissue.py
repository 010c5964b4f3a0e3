"""How long a stroke takes, beside its peers and its floor: python -m tests.benchmarks.bench_tissue
[--alone | --peers | --distinct]

One process, one thread, CPU seconds. Ours at hx = 2 and 1, set-up of a fresh geometry included; the floor,
which is as many bare factorisations of the same tangent as the stroke has positions, by turns with it;
unless --alone (with --peers nothing else), felupe (PyPI) and CalculiX (Debian calculix-ccx) on the same mesh,
material and load, by turns with ours; and the
thirty thesis strokes and a projection for many on a process pool. With --distinct: forty cases that differ in
all, against the reference. docs/performance.md has the tables.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.sim.tissue import Case, Settings, Stroke, read_design, simulate, sweep
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.geometry import forget_geometries
from palpate.sim.tissue.material import Tissue, elasticity
from palpate.sim.tissue.mesh import build_mesh
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.solver.choice import make_solver
from tests.benchmarks.peers import Peer

CODE = "d10h08e10f10"
ROUNDS, CASES = 15, 40
PEER_ROUNDS = {"felupe": 3, "CalculiX": 1, "CalculiX, locking": 1}
D_ALLOWED, PRESSURE_ALLOWED = 0.01, 0.03


def fresh(case: Case, settings: Settings) -> Stroke:
    """A stroke whose geometry has not been seen before."""
    forget_geometries()
    return simulate(case, settings)


def floor(case: Case, settings: Settings, solver: str) -> Callable[[], object]:
    """As many bare factorisations of the tangent at rest as the stroke has positions, and nothing else."""
    positions = settings.positions_mm()
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    tissue = Tissue(mesh, integrate(mesh), elasticity(case, mesh))
    m = len(mesh.elements)
    K, every = np.empty((m, 18, 18)), np.arange(m)
    tissue.tangent(np.zeros(2 * len(mesh.nodes_mm)), np.zeros((m, 3)), every, K, np.empty((m, 3, 18)))
    backend = make_solver(solver, mesh)
    contact = np.zeros((len(mesh.surface), 3))
    x = mesh.nodes_mm[mesh.surface, 0]
    contact[np.abs(x) < 12] = [0.0, 0.0, 1e6]

    def work() -> None:
        with one_blas_thread():
            for _ in positions:
                backend.change(K, every)
                backend.factor(contact, 0.0)

    return work


def cpu_s(action: Callable[[], object]) -> float:
    """CPU seconds of `action`."""
    began = time.process_time()
    action()
    return time.process_time() - began


def ours() -> dict[float, Stroke]:
    """Stroke and floors by turns, so that a machine that slows down slows all; medians of the rounds."""
    case, strokes = Case.from_code(CODE), {}
    print(f"{CODE}, 15 positions, CPU s on one thread (medians of {ROUNDS} rounds by turns)\n")
    print(
        "| hx | nodes | stroke | floor: 15 factorisations, ours | CHOLMOD | SuperLU | stroke / floor |",
        end="",
    )
    print(" factorisations | iterations |\n|---|---|---|---|---|---|---|---|---|", flush=True)
    for hx in (2.0, 1.0):
        settings = Settings(hx_mm=hx)
        floors = [floor(case, settings, name) for name in ("strip", "cholmod", "superlu")]
        for warm in floors:
            warm()
        runs, times = [fresh(case, settings)], []
        for _ in range(ROUNDS):
            runs.append(fresh(case, settings))
            times.append([runs[-1].cpu_s, *map(cpu_s, floors)])
        table = np.array(times)
        strokes[hx] = s = replace(runs[-1], cpu_s=float(np.median(table[:, 0])))
        cells = [f"{hx:g}", f"{s.nodes:,}", *(f"{t:.3f} s" for t in np.median(table, axis=0))]
        cells += [
            f"{np.median(table[:, 0] / table[:, 1]):.2f}",
            str(s.factorisations),
            str(s.iterations.sum()),
        ]
        print("| " + " | ".join(cells) + " |", flush=True)
    return strokes


def many() -> None:
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        sweep(read_design("thesis"), out_dir=folder + "/thesis", workers=2)
        print(f"\n30 thesis strokes on two processes, start-up included: {time.monotonic() - began:.1f} s")
        began = time.monotonic()
        sweep(read_design("sobol:128:3"), out_dir=folder + "/sobol", workers=2)
        wall = time.monotonic() - began
        print(f"128 Sobol strokes: {wall:.1f} s, so 1000 in {wall / 0.128:.0f} s")


def distinct() -> None:
    """Cases that differ in all, each between two strokes of the reference."""
    reference, settings = Case.from_code(CODE), Settings()
    print("| cases | strokes | CPU s | times the reference | nine of ten within |\n|---|---|---|---|---|")
    for words, design in (
        ("the thesis' tissue", f"sobol:{CASES}:3"),
        ("tissue of all kinds", f"any:{CASES}:3"),
    ):
        cases = {replace(case, F_rel=1.0): case for case in read_design(design)}  # one force of each lump
        before, rows = fresh(reference, settings).cpu_s, []
        for case in cases.values():
            took, after = fresh(case, settings).cpu_s, fresh(reference, settings).cpu_s
            rows.append((took, took / ((before + after) / 2)))
            before = after
        took, ratio = np.median(rows, axis=0)
        most = np.quantile([r for _, r in rows], 0.9)
        print(f"| {words} | {len(rows)} | {took:.3f} | {ratio:.2f} | {most:.2f} |", flush=True)


def peers(fine: Stroke) -> None:
    """Each peer between two strokes of ours, round by round; CPU seconds and ratios are medians."""
    from tests.benchmarks.peers import calculix_stroke, felupe_stroke

    case, settings = Case.from_code(CODE), Settings()
    print("\nThe same stroke at hx = 2, CPU s, by turns with ours (medians)\n")
    print("| program | rounds | nodes | solutions | CPU s | times ours | displacement | pressure |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    runs: dict[str, Callable[[Case, Settings], Peer]] = {
        "felupe": felupe_stroke.run,
        "CalculiX": calculix_stroke.run,
        "CalculiX, locking": lambda case, settings: calculix_stroke.run(case, settings, calculix_stroke.CPE4),
    }
    ours = [fresh(case, settings)]
    beside: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    found: dict[str, Peer] = {}
    for turn in range(max(PEER_ROUNDS.values())):
        for name, run in runs.items():
            if turn >= PEER_ROUNDS[name]:
                continue
            try:
                with one_blas_thread():
                    found[name] = run(case, settings)
            except (RuntimeError, ArithmeticError, OSError) as error:
                print(f"| {name} | did not get through: {error} |", flush=True)
                continue
            ours.append(fresh(case, settings))
            beside[name].append((found[name].cpu_s, (ours[-2].cpu_s + ours[-1].cpu_s) / 2))
    s, cpu = ours[-1], float(np.median([s.cpu_s for s in ours]))
    own = Peer("Palpate", s.nodes, cpu, s.displacement_mm, s.images_kPa, int(s.iterations.sum()))
    print_peer(own, len(ours), 1.0, fine)
    for name, peer in found.items():
        times = np.array(beside[name])
        peer = replace(peer, cpu_s=float(np.median(times[:, 0])))
        print_peer(peer, len(times), float(np.median(times[:, 0] / times[:, 1])), fine)
    print(
        "displacement (largest difference, 1 % allowed) and pressure (rms over the sensors, of the peak, 3 %"
    )
    print("allowed) against ours at hx = 1")


def print_peer(peer: Peer, rounds: int, times_ours: float, fine: Stroke) -> None:
    """A row: what it took, and how far it is from our stroke on a finer mesh."""
    depth = np.abs(peer.displacement_mm / fine.displacement_mm - 1).max()
    rms = np.sqrt(np.mean((peer.images_kPa - fine.images_kPa) ** 2, axis=1)) / fine.peak_kPa
    cells = [peer.name, str(rounds), f"{peer.nodes:,}", str(peer.iterations)]
    cells += [f"{peer.cpu_s:.2f}", f"{times_ours:.0f}"]
    cells += [
        f"{100 * depth:.2f} %" + " (too far)" * bool(depth > D_ALLOWED),
        f"{100 * rms.max():.1f} %" + " (too far)" * bool(rms.max() > PRESSURE_ALLOWED),
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    if "--peers" in sys.argv:
        peers(fresh(Case.from_code(CODE), Settings(hx_mm=1.0)))
        return
    if "--distinct" in sys.argv:
        distinct()
        return
    strokes = ours()
    if "--alone" not in sys.argv:
        peers(strokes[1.0])
    many()


if __name__ == "__main__":
    main()
