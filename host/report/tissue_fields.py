"""Strain, pressure and principal stretches in the tissue, for ParaView and for the eye. Units: mm, kPa."""

from __future__ import annotations

import xml.etree.ElementTree as xml
from collections.abc import Sequence
from pathlib import Path

import meshio
import numpy as np
from matplotlib.figure import Figure
from skfem import Basis, ElementQuad2, MeshQuad2
from skfem.visuals.matplotlib import plot

from palpate.files import whole_file
from palpate.sim.tissue.fields import Fields


def write_fields(path: Path, series: Sequence[Fields]) -> list[Path]:
    """Write `series` for ParaView: what `path` names, and one file for each position.

    `out.pvd` is the collection of `out_000.vtu`, `out_001.vtu` ..., the positions in mm being its times.
    Asked for `out.vtu`, it writes these and, as `out.vtu`, the last position by itself. Returns what was
    written, the collection first.

    Raises
    ------
    PalpateError
        A file cannot be written.
    """
    each = [path.with_name(f"{path.stem}_{i:03d}.vtu") for i in range(len(series))]
    for file, fields in zip(each, series):
        _write_vtu(file, fields)
    collection = path.with_suffix(".pvd")
    root = xml.Element("VTKFile", type="Collection", version="0.1")
    inside = xml.SubElement(root, "Collection")
    for file, fields in zip(each, series):
        xml.SubElement(inside, "DataSet", timestep=repr(fields.position_mm), part="0", file=file.name)
    xml.indent(root)
    with whole_file(collection) as temporary:
        xml.ElementTree(root).write(temporary, xml_declaration=True, encoding="utf-8")
    alone = []
    if path.suffix.lower() == ".vtu":
        _write_vtu(path, series[-1])
        alone = [path]
    return [collection, *each, *alone]


def _write_vtu(path: Path, fields: Fields) -> None:
    count, dim = fields.points_mm.shape
    points = np.column_stack([fields.points_mm, np.zeros((count, 3 - dim))])
    mesh = meshio.Mesh(
        points,
        {"quad9" if dim == 2 else "hexahedron27": fields.cells},
        point_data=dict(fields.values),
        cell_data={"material": [fields.material]},
    )
    with whole_file(path) as temporary:
        mesh.write(temporary, file_format="vtu")


def draw_fields(fields: Fields, code: str) -> Figure:
    """Pressure, vertical strain and the larger stretch on the deformed tissue, 30 mm round the lump."""
    moved = fields.points_mm + fields.values["displacement_mm"][:, :2]
    shown = {
        "pressure, kPa": fields.values["pressure_kPa"],
        "vertical strain": fields.values["strain"][:, 1],
        "larger principal stretch": fields.values["stretch_1"],
    }
    figure = Figure(figsize=(12, 3.4), layout="constrained")
    axes = figure.subplots(1, len(shown), sharey=True)
    near = np.nonzero((np.abs(moved[fields.cells][..., 0]) < 30.0).any(1))[0]
    quads = MeshQuad2(
        np.ascontiguousarray(moved.T), np.ascontiguousarray(fields.cells[near].T), validate=False
    )
    basis = Basis(quads, ElementQuad2())
    nodes = np.empty(basis.N, np.int64)
    nodes[basis.element_dofs] = fields.cells[near].T
    for ax, (title, values) in zip(axes, shown.items()):
        plot(basis, values[nodes], ax=ax, nrefs=2, shading="gouraud", cmap="cividis")
        figure.colorbar(ax.collections[-1], ax=ax, orientation="horizontal")
        ax.set(title=title, xlabel="mm", aspect="equal", xlim=(-30, 30))
        ax.axis("on")
    axes[0].set_ylabel("mm")
    figure.suptitle(f"{code}, probe at {fields.position_mm:g} mm")
    return figure
