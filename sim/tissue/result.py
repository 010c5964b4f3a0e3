"""A stroke: what the probe felt and how deep it sank, position by position. Units: mm, kPa, N/m."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.sim.tissue import symmetry
from palpate.sim.tissue.case import Case
from palpate.sim.tissue.face_sensors import SENSORS_MM
from palpate.sim.tissue.symmetry import Mirror

Floats = NDArray[np.float64]

_SERIES = ("positions_mm", "displacement_mm", "peak_mm", "peak_kPa", "force_error", "smallest_jacobian")


@dataclass(frozen=True)
class Stroke:
    """Result of one simulated stroke.

    Attributes
    ----------
    case : Case
        What was simulated.
    positions_mm : ndarray (n,)
        The probe's positions; the lump is under 0.
    displacement_mm : ndarray (n,)
        How far the probe's lowest point stands under the undeformed surface.
    images_kPa : ndarray (n, 16)
        Tactile images: mean pressure on each sensor of `sensors_mm`.
    peak_mm, peak_kPa : ndarray (n,)
        Where on the probe the contact pressure is greatest, and how great it is there.
    contact_mm : ndarray (n, 2)
        First and last place on the probe that touches.
    force_error : ndarray (n,)
        Sum of the contact forces over the force on the probe, less one.
    smallest_jacobian : ndarray (n,)
        Least volume ratio det F at any point of the tissue; negative would be turned inside out.
    iterations : ndarray (n,), int
        Newton iterations at each position.
    factorisations : int
        Of the whole stroke.
    nodes : int
        Size of the mesh.
    cpu_s : float
        CPU time.
    """

    case: Case
    positions_mm: Floats
    displacement_mm: Floats
    images_kPa: Floats
    peak_mm: Floats
    peak_kPa: Floats
    contact_mm: Floats
    force_error: Floats
    smallest_jacobian: Floats
    iterations: NDArray[np.int64]
    factorisations: int
    nodes: int
    cpu_s: float

    MIRRORS: ClassVar[dict[str, Mirror]] = {
        "positions_mm": symmetry.PLACES,
        "displacement_mm": symmetry.SERIES,
        "images_kPa": symmetry.IMAGES,
        "peak_mm": symmetry.PLACES,
        "peak_kPa": symmetry.SERIES,
        "contact_mm": symmetry.SPANS,
        "force_error": symmetry.SERIES,
        "smallest_jacobian": symmetry.SERIES,
        "iterations": symmetry.SERIES,
    }

    @property
    def code(self) -> str:
        """The case's code."""
        return self.case.code

    @property
    def F_N_per_m(self) -> float:
        """Force per metre of probe width."""
        return self.case.F_N_per_m

    @property
    def sensors_mm(self) -> Floats:
        """Places of the sensors along the probe."""
        return SENSORS_MM

    @property
    def strain(self) -> Floats:
        """Nominal strain of the fat, (n,): displacement over undeformed thickness."""
        return self.displacement_mm / self.case.t_mm

    def mirrored(self) -> Self:
        """The same stroke made from the other side."""
        back: dict[str, Any] = {name: how.of(getattr(self, name)) for name, how in self.MIRRORS.items()}
        return replace(self, **back)

    def full(self) -> Self:
        """The stroke continued to the other side by mirror symmetry, where it ends over the lump.

        Raises
        ------
        UsageError
            The stroke stops before the lump, or friction breaks the symmetry.
        """
        last = float(self.positions_mm[-1])
        over = symmetry.ends_over_lump(last)
        if last > 0 and not over:
            return self
        if not over or self.case.friction > 0.0:
            raise UsageError(
                f"{self.code}: only a frictionless stroke that ends over the lump has a mirror half"
            )
        along = {name: how for name, how in self.MIRRORS.items() if 0 in how.axes}
        whole: dict[str, Any] = {
            name: how.continued(getattr(self, name), last) for name, how in along.items()
        }
        return replace(self, **whole)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, for JSON; `from_dict` reads them back exactly."""
        arrays = (*_SERIES, "sensors_mm", "images_kPa", "contact_mm")
        out: dict[str, Any] = {"code": self.code, "F_N_per_m": self.F_N_per_m, "t_mm": self.case.t_mm}
        out |= {name: getattr(self, name).tolist() for name in arrays}
        out |= {"strain": self.strain.tolist(), "iterations": self.iterations.tolist()}
        out |= {"factorisations": self.factorisations, "nodes": self.nodes, "cpu_s": self.cpu_s}
        return out | {"case": self.case.to_dict()}

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> Stroke:
        """Read what `to_dict` wrote."""
        return cls(**cls.fields_of(record))

    @classmethod
    def fields_of(cls, record: dict[str, Any]) -> dict[str, Any]:
        """The fields of a stroke in what `to_dict` wrote."""
        n = len(record["positions_mm"])
        return {
            "case": Case(**record["case"]),
            **{name: np.asarray(record[name], float) for name in _SERIES},
            "images_kPa": np.asarray(record["images_kPa"], float).reshape(n, -1),
            "contact_mm": np.asarray(record["contact_mm"], float).reshape(n, 2),
            "iterations": np.asarray(record["iterations"], np.int64),
            "factorisations": int(record["factorisations"]),
            "nodes": int(record["nodes"]),
            "cpu_s": float(record["cpu_s"]),
        }
