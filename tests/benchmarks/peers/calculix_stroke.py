"""The stroke in CalculiX: node-to-surface contact with a stiff probe. Units: mm, kPa, mN per mm of width."""

from __future__ import annotations

import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from sim.tissue import Case, Settings
from sim.tissue.contact import read_sensors
from sim.tissue.material import elasticity
from sim.tissue.mesh import build_mesh
from sim.tissue.probe_shape import ProbeShape
from tests.benchmarks.peers import Peer

_QUARTERS = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
_THICKNESS_MM = 1.0
_CONTACT_SLOPE = 5e3  # kPa/mm
_PROBE_kPa = 1e5
_EXPONENT = 1.6


def run(case: Case, settings: Settings, depths_mm: np.ndarray) -> Peer:
    """Simulate the stroke of `case` on our mesh cut into linear elements (CPE4; CPE8R diverges).

    CalculiX does not converge under a force alone, so the probe's height is given, `depths_mm` (n,), and the
    force compared: what is returned as displacement is what the given force would need, by F = A D^1.6.
    """
    positions = settings.positions_mm()
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    constants = elasticity(case, mesh)
    cells = mesh.elements[:, _QUARTERS].reshape(-1, 4)
    owner = np.repeat(np.arange(len(mesh.elements)), 4)
    n, m = len(mesh.nodes_mm), len(cells)
    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    s = np.linspace(-13.5, 13.5, 109)
    face = np.stack([s + positions[0], case.t_mm + 0.01 + shape.height(s)[0]], 1)
    back = np.stack([s + positions[0], np.full(len(s), case.t_mm + 8.0)], 1)
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i + 1},{x:.10g},{y:.10g},0" for i, (x, y) in enumerate([*mesh.nodes_mm, *face, *back])]
    groups = {mu: np.nonzero(constants.mu[owner] == mu)[0] for mu in np.unique(constants.mu)}
    for k, (mu, which) in enumerate(groups.items()):
        bulk = constants.bulk[constants.mu == mu][0] - mu / 3
        lines.append(f"*ELEMENT, TYPE=CPE4, ELSET=G{k}")
        lines += [f"{e + 1}," + ",".join(str(v + 1) for v in cells[e]) for e in which]
        lines += [f"*MATERIAL, NAME=M{k}", "*HYPERELASTIC, NEO HOOKE", f"{mu / 2:.10g},{2 / bulk:.10g}"]
        lines += [f"*SOLID SECTION, ELSET=G{k}, MATERIAL=M{k}", f"{_THICKNESS_MM}"]
    count = len(s) - 1
    lines.append("*ELEMENT, TYPE=CPE4, ELSET=PROBE")
    f0, b0 = n + 1, n + 1 + len(s)
    lines += [f"{m + 1 + i},{f0 + i},{f0 + i + 1},{b0 + i + 1},{b0 + i}" for i in range(count)]
    lines += ["*MATERIAL, NAME=STIFF", "*ELASTIC", f"{_PROBE_kPa:g},0.3"]
    lines += ["*SOLID SECTION, ELSET=PROBE, MATERIAL=STIFF", f"{_THICKNESS_MM}"]
    lines += ["*NSET, NSET=BACK", *(f"{b0 + i}," for i in range(len(s)))]
    x = mesh.nodes_mm[mesh.surface, 0]
    lines += ["*NSET, NSET=SKIN", *(f"{v + 1}," for v in mesh.surface[(x > -60) & (x < 40)])]
    lines += ["*NSET, NSET=FLOOR", *(f"{v + 1}," for v in np.nonzero(mesh.fixed[:, 1])[0])]
    lines += ["*SURFACE, NAME=SLAVE, TYPE=NODE", "SKIN"]
    lines += ["*SURFACE, NAME=MASTER", *(f"{m + 1 + i},S1" for i in range(count))]
    lines += [
        "*SURFACE INTERACTION, NAME=SI",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{_CONTACT_SLOPE:g}",
    ]
    lines += ["*CONTACT PAIR, INTERACTION=SI, TYPE=NODE TO SURFACE", "SLAVE,MASTER"]
    lever = b0 + count // 2
    for i in range(len(s)):
        if b0 + i != lever:
            lines += ["*EQUATION", "2", f"{b0 + i},2,1,{lever},2,-1"]
    lines.append("*BOUNDARY")
    for node, (x, y) in enumerate(mesh.fixed):
        lines += [f"{node + 1},1,1"] * bool(x) + [f"{node + 1},2,2"] * bool(y)
    for k, (position, depth) in enumerate(zip(positions, depths_mm)):
        lines += ["*STEP, NLGEOM, INC=500", "*STATIC", "0.1,1,1e-6,0.5" if k else "0.02,1,1e-6,0.1"]
        lines += ["*BOUNDARY", f"BACK,1,1,{position - positions[0]:g}", f"{lever},2,2,{-depth - 0.01:.8g}"]
        lines += ["*NODE PRINT, NSET=SKIN, FREQUENCY=999", "U", "*CONTACT PRINT, FREQUENCY=999", "CSTR"]
        lines += ["*NODE PRINT, NSET=FLOOR, TOTALS=ONLY, FREQUENCY=999", "RF"]
        lines += ["*END STEP"]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "stroke.inp").write_text("\n".join(lines) + "\n")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        program = shutil.which("ccx") or "ccx"
        out = subprocess.run([program, "stroke"], cwd=work, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        text = (work / "stroke.dat").read_text() if (work / "stroke.dat").exists() else ""
        if not text or "*ERROR" in out.stdout:
            raise RuntimeError("CalculiX stopped: " + out.stdout[-400:])
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    force, images = _read(text, positions, mesh)
    displacement = depths_mm * (case.F_N_per_m / force) ** (1 / _EXPONENT)
    return Peer("CalculiX CPE4", n, cpu, displacement, images)


def _read(text, positions, mesh):
    """Force, N/m, and image at the end of every step."""
    per_time: dict[float, dict[str, list]] = {}
    rows: list = []
    for line in text.splitlines():
        if "time" in line:
            kind = "stress" if "stress" in line else "floor" if "FLOOR" in line else "skin"
            rows = per_time.setdefault(round(float(line.split()[-1]), 6), {}).setdefault(kind, [])
        elif line.strip():
            rows.append(line.split())
    forces, images = [], []
    x0 = mesh.nodes_mm[:, 0]
    for k, position in enumerate(positions):
        got = per_time[float(k + 1)]
        force = float(got["floor"][0][1]) / _THICKNESS_MM
        place = {int(row[0]): x0[int(row[0]) - 1] + float(row[1]) for row in got["skin"]}
        carried = dict.fromkeys(place, 0.0)
        for row in got["stress"]:
            carried[int(row[0])] = float(row[1])
        order = sorted(place, key=place.__getitem__)
        x, p = np.array([place[i] for i in order]), np.array([carried[i] for i in order])
        # The stress of a nodal slave surface belongs to an area of its own: only its shape is used.
        images.append(read_sensors(x - position, p * force / np.trapezoid(p, x)))
        forces.append(force)
    return np.array(forces), np.array(images)
