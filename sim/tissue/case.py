"""A case: the lump, the tissue round it and the probe pressed on it. `case_code.py` has its readable code.

Units: mm, kPa, N per metre of probe width (1 N/m = 1 kPa mm).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any

from palpate.sim.tissue.case_limits import LIMITS, ONLY_SOLID
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.face_sensors import WIDTH_MM
from palpate.sim.tissue.layers import DEEPER, UNDER_FAT, Layer, fields_of

FORCE_UNIT_N_PER_M = 100.0
"""F = 1.0 of a code, in N per metre of probe width (strain 19.7 % in the reference case)."""

SHAPES = {"cylinder": (math.inf, 1.0), "ball": (1.0, 1.0), "ellipsoid": (None, None)}
"""Half-axes across the stroke and downwards over d/2; None where each case has its own."""

LAWS = ("exponential", "ogden")
"""How tissue stiffens with strain, as `law.py` has it; the first goes without saying."""

NONLINEAR_E_RATIO = 1.0
NONLINEAR_STIFFENING = 900.0
"""The nonlinear lump of `eNL`: at rest as soft as fat, over E = 10 under the probe (docs/physics.md)."""

LIKE_FAT = 1.0001
"""E of a lump as stiff as fat; exactly 1 would be no lump at all, and the gland would go on in its place."""

FINE_REACH_MM = 14.0
"""How far the mesh's fine columns go on beyond the outermost positions, at least."""


@dataclass(frozen=True)
class Case:
    """One thing to simulate (thesis, "Definition of Input Parameters").

    Parameters
    ----------
    d_mm : float
        Diameter of the lump along the stroke. Unless `fat_mm` says otherwise it is centred on the border
        between fat and gland, under position 0.
    h : float
        Thickness of the tissue over the lump, in diameters.
    E_ratio : float
        Stiffness of the lump at rest over that of the fat. Exactly 1 means no lump at all.
    F_rel : float
        Force on the probe in units of 100 N per metre of probe width.
    lump_stiffening, fat_stiffening, gland_stiffening, muscle_stiffening : float
        b of the law; 0 is linear elasticity at large strain.
    law : str
        How what has a b stiffens, `LAWS`: `exponential`, W = mu/(2b) (exp(b (l1 - l2)^2) - 1), or `ogden`,
        W = 2 mu/a^2 (l1^a + l2^a + l3^a - 3) with a = 2 + b, for a cylinder.
    fat_kPa : float
        Young's modulus of the fat, kPa.
    gland_ratio, muscle_ratio : float
        Stiffness of gland and muscle over that of the fat.
    poisson : float
        Poisson's ratio of all tissue.
    gland_mm : float
        Depth of the gland, under the fat.
    muscle_mm : float, optional
        Depth of a muscle between gland and chest wall, where there is one. The lump does not reach it.
    probe_radius_mm : float
        Radius of the probe's face at its lowest point; `math.inf` is a flat one. The face is the parabola
        s^2 / 2R: the circle of R = 40 stands .02 mm (1.6 %) higher at s = 10 mm.
    face_half_mm : float
        Beyond this distance from its middle the face is rounded off.
    fillet_per_mm2 : float
        How sharply: the height there grows by fillet/6 (|s| - face_half)^3 mm.
    friction : float
        Coulomb coefficient of the sliding probe; 0 is frictionless. Only for a cylinder.
    shape : str
        `cylinder` (the thesis': endless across the stroke, plane strain), `ball` or `ellipsoid`.
    half_across_mm, half_down_mm : float, optional
        Half-axes of an ellipsoid across the stroke and downwards; that along the stroke is d/2.
    offset_mm : float
        How far the solid lump's middle lies beside the stroke's line, across the stroke.
    fat_mm : float, optional
        Thickness of the fat where the border to the gland need not pass through the lump's middle.
    padding_mm_per_kPa : float
        How far a padding on the face gives way under a pressure, each of its places by itself (a bed of
        springs): its thickness over its modulus. Only for a cylinder.
    across_radius_mm, across_half_mm, across_fillet_per_mm2 : float
        The face's radius across the stroke and its rounding off, as along it. Only for solid lumps.

    Raises
    ------
    CaseError
        A value is not finite or outside what makes sense.
    """

    d_mm: float
    h: float
    E_ratio: float
    F_rel: float = 1.0
    lump_stiffening: float = 0.0
    fat_stiffening: float = 0.0
    gland_stiffening: float = 0.0
    fat_kPa: float = 10.0
    gland_ratio: float = 6.0
    poisson: float = 0.495
    gland_mm: float = 15.0
    probe_radius_mm: float = 40.0
    face_half_mm: float = 10.0
    fillet_per_mm2: float = 0.1
    friction: float = 0.0
    shape: str = "cylinder"
    half_across_mm: float | None = None
    half_down_mm: float | None = None
    offset_mm: float = 0.0
    fat_mm: float | None = None
    padding_mm_per_kPa: float = 0.0
    across_radius_mm: float = 200.0
    across_half_mm: float = 17.0
    across_fillet_per_mm2: float = 0.1
    law: str = LAWS[0]
    muscle_mm: float | None = None
    muscle_ratio: float = 6.0
    muscle_stiffening: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            raw = getattr(self, name)
            if raw is None and name in _OPTIONAL:
                continue
            try:
                value = float(raw) + 0.0  # no negative zero
            except (TypeError, ValueError):
                raise CaseError(f"{name} must be a number, not {raw!r}") from None
            if not low <= value <= high:  # as NaN does not
                raise CaseError(f"{name} must lie between {low:g} and {high:g}, not {value:g}")
            object.__setattr__(self, name, value)
        for layer in DEEPER:
            mm, *others = fields_of(layer)
            if getattr(self, mm) is None and any(getattr(self, name) != _DEFAULTS[name] for name in others):
                raise CaseError(f"a case without {mm} has no {layer} whose stiffness could be given")
        self._check_shape()

    def _check_shape(self) -> None:
        if self.law not in LAWS:
            raise CaseError(f"law must be one of {', '.join(LAWS)}, not {self.law!r}")
        if self.solid and self.law != LAWS[0]:
            raise CaseError(f"a {self.shape} stiffens by the exponential law only, not by {self.law!r}")
        if self.shape not in SHAPES:
            raise CaseError(f"shape must be one of {', '.join(SHAPES)}, not {self.shape!r}")
        axes = (self.half_across_mm is not None, self.half_down_mm is not None)
        if any(axes) if self.shape != "ellipsoid" else not all(axes):
            raise CaseError("half_across_mm and half_down_mm belong to an ellipsoid, which needs both")
        if not self.solid:
            if extra := [name for name in ONLY_SOLID if getattr(self, name) != _DEFAULTS[name]]:
                raise CaseError(f"a cylinder has no {extra[0]}: that takes a ball or an ellipsoid")
        elif self.friction or self.padding_mm_per_kPa:
            what = "friction is" if self.friction else "padding is"
            raise CaseError(f"{what} for cylinders only: a {self.shape} is stroked without")
        below = self.depth_mm + 2 * self.half_down
        placed = self.solid or (self.fat_mm is not None and self.has_lump)  # others: where they are meshed
        if placed and below > self.t_mm + 0.97 * self.gland_mm:
            raise CaseError(
                f"a lump that reaches {below:g} mm down does not fit over "
                f"a {self.under_gland} at {self.t_mm + self.gland_mm:g} mm"
            )

    @property
    def solid(self) -> bool:
        """True for a lump that ends across the stroke: a stroke in three dimensions."""
        return self.shape != "cylinder"

    @property
    def half_axes_mm(self) -> tuple[float, float, float]:
        """Half-axes of the lump along the stroke, across it (endless for a cylinder) and downwards, mm."""
        r, across = self.d_mm / 2, SHAPES[self.shape][0]
        if across is None:
            assert self.half_across_mm is not None
            return r, self.half_across_mm, self.half_down
        return r, r * across, self.half_down

    @property
    def half_down(self) -> float:
        """Half of the lump's height, mm."""
        down = SHAPES[self.shape][1]
        return self.half_down_mm or self.d_mm / 2 if down is None else down * self.d_mm / 2

    @property
    def t_mm(self) -> float:
        """Thickness of the fat, mm."""
        if self.fat_mm is not None:
            return self.fat_mm
        if self.half_down_mm is not None or self.half_down != self.d_mm / 2:
            return self.d_mm * self.h + self.half_down
        return self.d_mm * (self.h + 0.5)

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Fat, gland and what else there is, from the skin down to the chest wall."""
        below = (Layer(name, *(getattr(self, field) for field in fields_of(name))) for name in UNDER_FAT)
        fat = Layer("fat", self.t_mm, 1.0, self.fat_stiffening)
        return (fat, *(layer for layer in below if layer.mm is not None))

    @property
    def under_gland(self) -> str:
        """What the gland lies on, in words."""
        return self.layers[2].name if len(self.layers) > 2 else "chest wall"

    @property
    def centre_mm(self) -> float:
        """Depth of the lump's middle under the skin, mm."""
        return self.t_mm if self.fat_mm is None else self.depth_mm + self.half_down

    @property
    def border_mm(self) -> float:
        """Height of the border between fat and gland over the lump's middle, mm."""
        return self.centre_mm - self.t_mm

    @property
    def borders_mm(self) -> tuple[float, ...]:
        """Heights of the layers' lower ends over the lump's middle, downwards, mm; last the chest wall."""
        heights = [self.border_mm]
        for layer in self.layers[1:]:
            heights.append(heights[-1] - layer.mm)
        return tuple(heights)

    @property
    def depth_mm(self) -> float:
        """Thickness of the tissue over the lump, mm."""
        return self.d_mm * self.h

    @property
    def reach_mm(self) -> float:
        """How far from its middle the face may touch, mm: where the rounding has risen 1.07 mm."""
        return max(FINE_REACH_MM, self.face_half_mm + (6.4 / self.fillet_per_mm2) ** (1 / 3))

    @property
    def F_N_per_m(self) -> float:
        """Force per metre of probe width, N/m."""
        return FORCE_UNIT_N_PER_M * self.F_rel

    @property
    def F_N(self) -> float:
        """Force on the whole probe, N."""
        return self.F_N_per_m * WIDTH_MM / 1000

    @property
    def E_inv23(self) -> float:
        """(Stiffness of the lump over the fat's)^(-2/3)."""
        return float(self.E_ratio ** (-2 / 3))

    @property
    def E_fat_kPa(self) -> float:
        """Young's modulus of the fat at rest, kPa, under the output's name."""
        return self.fat_kPa

    @property
    def has_lump(self) -> bool:
        """False where the lump is as stiff as the fat, which the thesis uses for "no lump"."""
        return self.E_ratio != 1.0 or self.lump_stiffening > 0.0

    @property
    def nonlinear_lump(self) -> bool:
        """True for a lump that stiffens with strain."""
        return self.lump_stiffening > 0.0

    @classmethod
    def without_lump(cls, t_mm: float, F_rel: float = 1.0, **options: Any) -> Case:
        """Plain fat of thickness `t_mm` over gland, as a case with E = 1, at F_rel times 100 N/m."""
        if not 0.3 <= t_mm <= 200.0:
            raise CaseError(f"t_mm must lie between 0.3 and 200, not {t_mm:g}")
        d = min(20.0, max(min(5.0, t_mm / 0.7), t_mm / 1.3))
        d = min(d, 1.9 * options.get("gland_mm", d))  # the gland must hold half of it
        return cls(d_mm=d, h=t_mm / d - 0.5, E_ratio=1.0, F_rel=F_rel, **options)

    @classmethod
    def from_code(cls, code: str) -> Case:
        """Read a code such as `d10h08e10f10`, `d10h08eNLf10`, `d10h08e10f10_ball_y5` or
        `d12.3h0.85e7.4f0.66_R60`.

        Raises
        ------
        CaseError
            The code cannot be read or describes an impossible case.
        """
        from palpate.sim.tissue.case_code import read_code

        return cls(**read_code(code))

    @property
    def code(self) -> str:
        """The shortest code that `from_code` reads back as exactly this case."""
        from palpate.sim.tissue.case_code import write_code

        return write_code(self)

    def to_dict(self) -> dict[str, Any]:
        """The fields; of a cylinder those only which it can have."""
        out = asdict(self)
        if self.law == LAWS[0]:  # which went without saying when it was the only one
            del out["law"]
        for layer in DEEPER:
            mm, *others = fields_of(layer)
            if out[mm] is None:
                for name in (mm, *others):
                    del out[name]
        if not self.padding_mm_per_kPa:  # so did a bare face
            del out["padding_mm_per_kPa"]
        if not self.solid:
            for name in (*SOLID_FIELDS, *(["fat_mm"] if self.fat_mm is None else [])):
                del out[name]
        return out


SOLID_FIELDS = ("shape", *ONLY_SOLID)
"""Fields that a cylinder's record leaves out."""

_DEFAULTS = {f.name: f.default for f in fields(Case)}
_OPTIONAL = tuple(name for name, default in _DEFAULTS.items() if default is None)
