"""The stroke in CalculiX: linear elements with reduced integration, node-to-surface contact.

What was tried (CalculiX 2.20): CPE4 locks (displacement 4 % short); CPE8R and CPE8 converge while they are
pressed but not on the way to the next position, with either kind of contact; C3D8I does not get as far.
CPE4R neither locks nor diverges, if the probe's face does not slide along the surface: here the nodes of a
long strip move up and down so that its lower side is the face at every position, which without friction is
the same. Units: mm, kPa, N per metre of width.
"""

from __future__ import annotations

import re
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.contact import read_sensors
from palpate.sim.tissue.material import elasticity
from palpate.sim.tissue.mesh import TissueMesh, build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape
from tests.benchmarks.peers import QUARTERS, Peer

_CONTACT_SLOPE = 1e3  # kPa/mm: the probe sinks in by .2 % of the displacement
_PITCH_MM = 0.25  # of the strip's nodes
_REACH_MM = 16.0  # of the strip beyond the outermost positions
_CLEARANCE_MM = 0.01
_HIGHEST_MM = 5.0  # of the face: farther out it touches nothing
_EXPONENT = 1.6
_FIRST = "0.1,1,1e-5,0.25"
_OTHERS = "0.004,1,1e-6,1"
"""Increments of a step: the first must be small, since CalculiX extrapolates only from the second on."""


def run(case: Case, settings: Settings, depths_mm: np.ndarray, timeout_s: float = 400.0) -> Peer:
    """Simulate the stroke of `case` on our mesh, every nine-node element cut into four.

    Under a force alone CalculiX does not converge, so the probe's height is given, `depths_mm` (n,), and the
    force compared: what is returned as displacement is what the given force would need, by F = A D^1.6.

    Raises
    ------
    RuntimeError
        CalculiX stopped before the end, or took longer than `timeout_s`.
    OSError
        It is not installed.
    """
    positions = settings.positions_mm()
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    program = shutil.which("ccx")
    if program is None:
        raise FileNotFoundError("CalculiX (Debian calculix-ccx) is not installed")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "stroke.inp").write_text("\n".join(_deck(case, mesh, positions, depths_mm)) + "\n")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            out = subprocess.run(
                [program, "stroke"], cwd=work, capture_output=True, text=True, timeout=timeout_s
            )
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"CalculiX was stopped after {timeout_s:.0f} s") from None
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if "Job finished" not in out.stdout:
            raise RuntimeError("CalculiX stopped: " + " ".join(re.findall(r"\*ERROR.*", out.stdout)))
        force, images = _read(work, positions, mesh)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    displacement = depths_mm * (case.F_N_per_m / force) ** (1 / _EXPONENT)
    return Peer("CalculiX CPE4R", len(mesh.nodes_mm), cpu, displacement, images)


def _deck(case: Case, mesh: TissueMesh, positions: np.ndarray, depths_mm: np.ndarray) -> list[str]:
    """CalculiX' input, line by line."""
    constants = elasticity(case, mesh)
    cells = mesh.elements[:, QUARTERS].reshape(-1, 4)
    owner = np.repeat(np.arange(len(mesh.elements)), 4)
    n, m = len(mesh.nodes_mm), len(cells)
    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    x = np.arange(positions[0] - _REACH_MM, positions[-1] + _REACH_MM + _PITCH_MM / 2, _PITCH_MM)
    lower, upper = n + 1 + np.arange(len(x)), n + 1 + len(x) + np.arange(len(x))

    def face(position: float) -> np.ndarray:
        out: np.ndarray = np.minimum(shape.height(x - position)[0], _HIGHEST_MM)
        return out

    start = face(positions[0])
    strip = np.stack([x, case.t_mm + _CLEARANCE_MM + start], 1)
    nodes = np.concatenate([mesh.nodes_mm, strip, strip + np.array([0.0, 3.0])])
    lines = ["*NODE, NSET=ALL", *(f"{i + 1},{a:.10g},{b:.10g},0" for i, (a, b) in enumerate(nodes))]
    for k, mu in enumerate(np.unique(constants.mu)):
        bulk = constants.bulk[constants.mu == mu][0] - mu / 3
        lines.append(f"*ELEMENT, TYPE=CPE4R, ELSET=G{k}")
        which = np.nonzero(constants.mu[owner] == mu)[0]
        lines += [f"{e + 1}," + ",".join(str(v + 1) for v in cells[e]) for e in which]
        lines += [f"*MATERIAL, NAME=M{k}", "*HYPERELASTIC, NEO HOOKE", f"{mu / 2:.10g},{2 / bulk:.10g}"]
        lines += [f"*SOLID SECTION, ELSET=G{k}, MATERIAL=M{k}", "1."]
    lines.append("*ELEMENT, TYPE=CPE4, ELSET=PROBE")
    lines += [f"{m + 1 + i},{lower[i]},{lower[i + 1]},{upper[i + 1]},{upper[i]}" for i in range(len(x) - 1)]
    lines += ["*MATERIAL, NAME=PROBE", "*ELASTIC", "0.001,0.0"]  # every node of it is moved by hand
    lines += ["*SOLID SECTION, ELSET=PROBE, MATERIAL=PROBE", "1."]

    skin = _skin_cells(mesh, cells, positions)
    lines += ["*NSET, NSET=SKIN", *(f"{v + 1}," for v in np.unique(cells[skin][:, [2, 3]]))]
    lines += ["*NSET, NSET=FLOOR", *(f"{v + 1}," for v in np.nonzero(mesh.fixed[:, 1])[0])]
    lines += ["*NSET, NSET=FACE", *(f"{v}," for v in [*lower, *upper])]
    lines += ["*SURFACE, NAME=SLAVE", *(f"{e + 1},S3" for e in skin)]
    lines += ["*SURFACE, NAME=MASTER", *(f"{m + 1 + i},S1" for i in range(len(x) - 1))]
    lines += ["*SURFACE INTERACTION, NAME=SI", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
    lines += [f"{_CONTACT_SLOPE:g}", "*CONTACT PAIR, INTERACTION=SI, TYPE=NODE TO SURFACE", "SLAVE,MASTER"]
    lines += ["*BOUNDARY", "FACE,1,1"]
    for node, (held_x, held_y) in enumerate(mesh.fixed):
        lines += [f"{node + 1},1,1"] * bool(held_x) + [f"{node + 1},2,2"] * bool(held_y)
    for k, (position, depth) in enumerate(zip(positions, depths_mm)):
        lines += ["*STEP, NLGEOM, INC=500", "*STATIC", _OTHERS if k else _FIRST]
        if k == 0:  # steps may grow by 2.5 in place of 1.5
            lines += ["*CONTROLS, PARAMETERS=TIME INCREMENTATION", "4,8,9,16,10,4,,5"]
            lines += ["0.25,0.5,0.75,0.85,,,2.5"]
        rise = face(position) - start - depth - _CLEARANCE_MM
        lines += ["*BOUNDARY", *(f"{v},2,2,{r:.8g}" for row in (lower, upper) for v, r in zip(row, rise))]
        lines += ["*NODE PRINT, NSET=SKIN, FREQUENCY=999", "U", "*CONTACT PRINT, FREQUENCY=999", "CSTR"]
        lines += ["*NODE PRINT, NSET=FLOOR, TOTALS=ONLY, FREQUENCY=999", "RF", "*END STEP"]
    return lines


def _skin_cells(mesh: TissueMesh, cells: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Cells whose third side is the surface that may be touched."""
    surface = np.zeros(len(mesh.nodes_mm), bool)
    surface[mesh.surface] = True
    x = mesh.nodes_mm[cells[:, 3], 0]
    near = (x > positions[0] - _REACH_MM + 1) & (x < positions[-1] + _REACH_MM - 2)
    return np.nonzero(surface[cells[:, 2]] & surface[cells[:, 3]] & near)[0]


def _read(work: Path, positions: np.ndarray, mesh: TissueMesh) -> tuple[np.ndarray, np.ndarray]:
    """Force, N/m, and image at the end of every step."""
    original = _flat_nodes((work / "stroke.12d").read_text())
    per_time: dict[float, dict[str, list]] = {}
    rows: list = []
    for line in (work / "stroke.dat").read_text().splitlines():
        if "time" in line:
            kind = "stress" if "stress" in line else "floor" if "FLOOR" in line else "skin"
            rows = per_time.setdefault(round(float(line.split()[-1]), 6), {}).setdefault(kind, [])
        elif line.strip():
            rows.append(line.split())
    forces, images = [], []
    for k, position in enumerate(positions):
        got = per_time[float(k + 1)]
        force = float(got["floor"][0][1])
        place = {int(row[0]): mesh.nodes_mm[int(row[0]) - 1, 0] + float(row[1]) for row in got["skin"]}
        carried = dict.fromkeys(place, 0.0)
        for row in got["stress"]:
            carried[original[int(row[0])]] = float(row[1])
        order = sorted(place, key=place.__getitem__)
        x, p = np.array([place[i] for i in order]), np.array([carried[i] for i in order])
        images.append(read_sensors(x - position, p * force / np.trapezoid(p, x)))
        forces.append(force)
    return np.array(forces), np.array(images)


def _flat_nodes(text: str) -> dict[int, int]:
    """CalculiX makes solids of plane elements: the plane's node for every node of a solid."""
    out: dict[int, int] = {}
    numbers = [list(map(int, line.split())) for line in text.splitlines() if re.fullmatch(r"[\s\d]+", line)]
    numbers = [row for row in numbers if row]
    for flat, solid in zip(numbers[::2], numbers[1::2]):
        out.update(zip(solid, flat + flat))
    return out
