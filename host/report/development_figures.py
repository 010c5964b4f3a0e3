"""Figure 6 a to c: steps on the way to the final model, and what each makes of the tactile image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from palpate.features.map_features import Floats
from palpate.regression.table import REFERENCE_CODE
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.report.tissue_figures import draw_mesh
from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.deformation import Pressed, deformation
from palpate.sim.tissue.face_sensors import SENSORS_MM
from palpate.sim.tissue.mesh import TissueMesh, build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape

NAME, TITLE = "Figure 6a to c", "Development of the Finite Element Model: on the way there"
_FINAL = Case.from_code(REFERENCE_CODE)
_COARSE = Settings(hx_mm=4.0, skin_mm=(3.5,), left_mm=-75.0, right_mm=75.0)


@dataclass(frozen=True)
class Step:
    """A model on the way to the final one."""

    words: str
    case: Case
    settings: Settings


STEPS = (
    Step(
        "a: flat face, coarse elements",
        replace(_FINAL, probe_radius_mm=math.inf, face_half_mm=11.0, fillet_per_mm2=1.0),
        _COARSE,
    ),
    Step("b: round face, coarse elements", _FINAL, _COARSE),
    Step(
        "c: small elements everywhere",
        _FINAL,
        Settings(hx_mm=1.0, skin_mm=(1.0,), row_mm=1.0, gland_row_mm=2.0),
    ),
)
FINAL = Step("d: large elements under a skin of small ones", _FINAL, Settings())


def items(*, simulate: bool) -> list[Item]:
    """The steps' meshes; with `simulate` the tactile images that they give, too (some seconds)."""
    meshes = [_mesh(step) for step in STEPS]
    pressed = [_pressed(step) for step in (*STEPS, FINAL)] if simulate else []
    sizes = ", ".join(str(len(mesh.nodes_mm)) for mesh in meshes)
    beside = [
        Beside("nodes", "more and more; about 3000 in the end", f"{sizes}; d: {len(_mesh(FINAL).nodes_mm)}")
    ]
    if pressed:
        beside.append(
            Beside("tactile image of coarse elements", '"a lot of noise"', _off(pressed[1], pressed[2]))
        )
        beside.append(Beside("tactile image under a fine skin", "smooth", _off(pressed[3], pressed[2])))
    return [
        Item(
            NAME,
            TITLE,
            "The thesis' own a to c are lost; its text says what they tried: several shapes of the probe, "
            "sizes of the layers, smaller elements, at last a thin skin of very small ones (d). These are "
            "three such steps. Pressed over the lump, with the tactile image beside.",
            beside,
            lambda: figure_6abc(meshes, pressed),
        )
    ]


def figure_6abc(meshes: Sequence[TissueMesh], pressed: Sequence[Pressed]) -> Figure:
    """A row for each step: the mesh round the lump, and the image there if it was pressed."""
    figure = style.new(8.4, 6.4)
    columns = figure.subplots(
        len(STEPS), 2 if pressed else 1, squeeze=False, width_ratios=(1.3, 1)[: 2 if pressed else 1]
    )
    for k, (step, mesh) in enumerate(zip(STEPS, meshes)):
        ax, case = columns[k, 0], step.case
        draw_mesh(ax, mesh, pressed[k].nodes_mm if pressed else mesh.nodes_mm)
        s = np.linspace(-14, 14, 141)
        height = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2).height(s)[0]
        keep = height < 6.0
        face = pressed[k].face_mm if pressed else np.column_stack((s, case.t_mm + height))
        ax.add_patch(
            Polygon(np.vstack((face[keep], [[9, 24], [-9, 24]])), fc="#c9d4dc", ec=style.SOFT, lw=0.8)
        )
        ax.set(xlim=(-34, 34), ylim=(-15.5, 22), ylabel="mm")
        ax.set_title(step.words)
        if pressed:
            _image(columns[k, 1], pressed[k], pressed[-1].image_kPa)
    columns[-1, 0].set_xlabel("mm")
    if pressed:
        columns[-1, 1].set_xlabel("place on the probe (mm)")
        columns[0, 1].legend()
    return figure


def _image(ax: Axes, state: Pressed, final: Floats) -> None:
    ax.plot(SENSORS_MM, final, lw=1, color=style.SOFT, label="d")
    ax.plot(SENSORS_MM, state.image_kPa, "o-", ms=3, label="this one")
    ax.set(ylabel="pressure (kPa)", ylim=(0, 6.4))


def _mesh(step: Step) -> TissueMesh:
    return build_mesh(step.case, step.settings, -28.0, 0.0)


def _pressed(step: Step) -> Pressed:
    """Pressed over the lump."""
    return deformation(step.case, (-28.0, 0.0), step.settings)[1][-1]


def _off(state: Pressed, fine: Pressed) -> str:
    off = state.image_kPa - fine.image_kPa
    return f"{100 * np.sqrt(np.mean(off**2)) / fine.image_kPa.max():.1f} % of the peak off that of c, rms"
