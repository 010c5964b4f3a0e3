"""The stroke in CalculiX: linear elements with reduced integration, node-to-surface contact, force given.

What was tried (CalculiX 2.20): CPE4 locks (displacement 4 % short), in half of the time; CPE8R and CPE8
converge while they are pressed but not on the way to the next position, with either kind of contact; C3D8I
does not get as far. CPE4R neither locks nor diverges. On its way to the next position it needs small
increments, and does not converge under a force; but without friction a state does not depend on the way to
it, so every position is an indentation of its own: down to the depth of the position before, then released
to the force.
Units: mm, kPa, N per metre of width.
"""

from __future__ import annotations

import re
import resource
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.material import elasticity
from palpate.sim.tissue.mesh import TissueMesh, build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.reading import read_sensors
from tests.benchmarks.peers import QUARTERS, Peer

_CONTACT_SLOPE = (
    300.0  # kPa/mm: the probe sinks in by .5 % of the displacement; three times as much does not converge
)
_PITCH_MM = 0.25  # of the probe's nodes
_REACH_MM = 16.0  # of the probe to either side
_HIGHEST_MM = 5.0  # of the face: farther out it touches nothing
_FIRST_DEPTH_MM = 2.4
_RELEASED = "1,1,1e-4,1"
"""Increments of the second step, by force: one."""


@dataclass(frozen=True)
class Deck:
    """What lets one kind of element converge: increments of the first step, by depth; how far from the
    tissue the probe begins; modulus, kPa, and Poisson's ratio of the probe, whose nodes move as one."""

    element: str
    down: str
    clearance_mm: float
    probe: str


CPE4R = Deck("CPE4R", "0.17,1,1e-4,0.17", 0.01, "0.001,0.0")
CPE4 = Deck("CPE4", "0.2,1,1e-4,1", -0.02, "1e-6,0.0")


def run(case: Case, settings: Settings, kind: Deck = CPE4R, timeout_s: float = 400.0) -> Peer:
    """Simulate the stroke of `case` on our mesh, every nine-node element cut into four.

    Raises
    ------
    RuntimeError
        CalculiX stopped before the end of a position, or took longer than `timeout_s` for it.
    OSError
        It is not installed.
    """
    program = shutil.which("ccx")
    if program is None:
        raise FileNotFoundError("CalculiX (Debian calculix-ccx) is not installed")
    positions = settings.positions_mm()
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    depth, depths, images, iterations = _FIRST_DEPTH_MM, [], [], 0
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for position in positions:
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            deck, skin = _deck(case, mesh, float(position), depth, kind)
            (work / "press.inp").write_text("\n".join(deck) + "\n")
            command = [program, "press"]
            try:
                out = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=timeout_s)
            except subprocess.TimeoutExpired:
                raise RuntimeError(f"CalculiX was stopped after {timeout_s:.0f} s") from None
            if "Job finished" not in out.stdout:
                raise RuntimeError("CalculiX stopped: " + " ".join(re.findall(r"\*ERROR.*", out.stdout)))
            depth, x, pressure = _read(work, mesh, skin)
            depth -= kind.clearance_mm
            iterations += _iterations((work / "press.sta").read_text())
        depths.append(depth)
        images.append(read_sensors(x - position, pressure * case.F_N_per_m / np.trapezoid(pressure, x)))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    name = f"CalculiX {kind.element}"
    return Peer(name, len(mesh.nodes_mm), cpu, np.array(depths), np.array(images), iterations)


def _deck(
    case: Case, mesh: TissueMesh, position: float, depth: float, kind: Deck
) -> tuple[list[str], np.ndarray]:
    """CalculiX' input, line by line, and the nodes of the skin that may be touched."""
    constants = elasticity(case, mesh)
    cells = mesh.elements[:, QUARTERS].reshape(-1, 4)
    owner = np.repeat(np.arange(len(mesh.elements)), 4)
    n, m = len(mesh.nodes_mm), len(cells)
    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    s = np.arange(-_REACH_MM, _REACH_MM + _PITCH_MM / 2, _PITCH_MM)
    face = case.t_mm + kind.clearance_mm + np.minimum(shape.height(s)[0], _HIGHEST_MM)
    lower, upper = n + 1 + np.arange(len(s)), n + 1 + len(s) + np.arange(len(s))
    leader = int(upper[len(s) // 2])  # whose height all the others have
    strip = np.stack([position + s, face], 1)
    top = np.stack([position + s, np.full(len(s), case.t_mm + _HIGHEST_MM + 3.0)], 1)

    nodes = np.concatenate([mesh.nodes_mm, strip, top])
    lines = ["*NODE, NSET=ALL", *(f"{i + 1},{a:.10g},{b:.10g},0" for i, (a, b) in enumerate(nodes))]
    for k, mu in enumerate(np.unique(constants.mu)):
        bulk = constants.bulk[constants.mu == mu][0] - mu / 3
        lines.append(f"*ELEMENT, TYPE={kind.element}, ELSET=G{k}")
        which = np.nonzero(constants.mu[owner] == mu)[0]
        lines += [f"{e + 1}," + ",".join(str(v + 1) for v in cells[e]) for e in which]
        lines += [f"*MATERIAL, NAME=M{k}", "*HYPERELASTIC, NEO HOOKE", f"{mu / 2:.10g},{2 / bulk:.10g}"]
        lines += [f"*SOLID SECTION, ELSET=G{k}, MATERIAL=M{k}", "1."]
    lines.append("*ELEMENT, TYPE=CPE4, ELSET=PROBE")
    lines += [f"{m + 1 + i},{lower[i]},{lower[i + 1]},{upper[i + 1]},{upper[i]}" for i in range(len(s) - 1)]
    lines += ["*MATERIAL, NAME=PROBE", "*ELASTIC", kind.probe]
    lines += ["*SOLID SECTION, ELSET=PROBE, MATERIAL=PROBE", "1."]
    for v in [*lower, *upper]:
        if v != leader:
            lines += ["*EQUATION", "2", f"{v},2,1.,{leader},2,-1."]

    touched = _skin_cells(mesh, cells, position)
    skin = np.unique(cells[touched][:, [2, 3]])
    lines += ["*NSET, NSET=SKIN", *(f"{v + 1}," for v in skin)]
    lines += ["*NSET, NSET=FACE", *(f"{v}," for v in [*lower, *upper])]
    lines += ["*NSET, NSET=LEADER", f"{leader},"]
    lines += ["*SURFACE, NAME=SLAVE", *(f"{e + 1},S3" for e in touched)]
    lines += ["*SURFACE, NAME=MASTER", *(f"{m + 1 + i},S1" for i in range(len(s) - 1))]
    lines += ["*SURFACE INTERACTION, NAME=SI", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
    lines += [f"{_CONTACT_SLOPE:g}", "*CONTACT PAIR, INTERACTION=SI, TYPE=NODE TO SURFACE", "SLAVE,MASTER"]
    held = ["FACE,1,1"]
    for node, (held_x, held_y) in enumerate(mesh.fixed):
        held += [f"{node + 1},1,1"] * bool(held_x) + [f"{node + 1},2,2"] * bool(held_y)
    lines += ["*STEP, NLGEOM, INC=200", "*STATIC", kind.down, "*BOUNDARY", *held]
    lines += [f"{leader},2,2,{-depth - kind.clearance_mm:.8g}"]
    lines += ["*CLOAD", f"{leader},2,{-case.F_N_per_m:.8g}", "*END STEP"]  # felt once the depth is let go
    lines += ["*STEP, NLGEOM, INC=200", "*STATIC", _RELEASED, "*BOUNDARY, OP=NEW", *held]
    lines += ["*NODE PRINT, NSET=SKIN, FREQUENCY=999", "U", "*NODE PRINT, NSET=LEADER, FREQUENCY=999", "U"]
    lines += ["*CONTACT PRINT, FREQUENCY=999", "CSTR", "*END STEP"]
    return lines, skin


def _skin_cells(mesh: TissueMesh, cells: np.ndarray, position: float) -> np.ndarray:
    """Cells whose third side is the surface that may be touched."""
    surface = np.zeros(len(mesh.nodes_mm), bool)
    surface[mesh.surface] = True
    near = np.abs(mesh.nodes_mm[cells[:, 3], 0] - position) < _REACH_MM - 2
    return np.nonzero(surface[cells[:, 2]] & surface[cells[:, 3]] & near)[0]


def _read(work: Path, mesh: TissueMesh, skin: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """How far the probe has moved, mm, the skin's nodes from left to right, mm, the pressure on them."""
    original = _flat_nodes((work / "press.12d").read_text())
    got: dict[str, list[list[str]]] = {}
    for line in (work / "press.dat").read_text().splitlines():
        if "time" in line:
            kind = "stress" if "stress" in line else "leader" if "LEADER" in line else "skin"
            rows = got[kind] = []  # of the last step
        elif line.strip():
            rows.append(line.split())
    place = {int(row[0]): mesh.nodes_mm[int(row[0]) - 1, 0] + float(row[1]) for row in got["skin"]}
    carried = dict.fromkeys(place, 0.0)
    for row in got["stress"]:
        carried[original[int(row[0])]] = float(row[1])
    order = sorted(place, key=place.__getitem__)
    depth = -float(got["leader"][0][2])
    return depth, np.array([place[i] for i in order]), np.array([carried[i] for i in order])


def _iterations(text: str) -> int:
    """From CalculiX' table of increments, attempts that failed included."""
    rows = [line.split() for line in text.splitlines()[2:]]
    return sum(int(row[3]) for row in rows if row)


def _flat_nodes(text: str) -> dict[int, int]:
    """CalculiX makes solids of plane elements: the plane's node for every node of a solid."""
    out: dict[int, int] = {}
    numbers = [list(map(int, line.split())) for line in text.splitlines() if re.fullmatch(r"[\s\d]+", line)]
    numbers = [row for row in numbers if row]
    for flat, solid in zip(numbers[::2], numbers[1::2]):
        out.update(zip(solid, flat + flat))
    return out
