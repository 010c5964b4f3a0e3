"""The columns of a data set. Units: mm, kPa, N per metre of probe width."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.errors import UsageError


class DataSetError(UsageError):
    """A data set cannot be used; the sentence names row and column."""


@dataclass(frozen=True)
class Column:
    """One column: its name, what it says, and for a number between which limits it can lie at all."""

    name: str
    says: str
    low: float = 0.0
    high: float = 0.0

    @property
    def number(self) -> bool:
        """Whether it holds numbers."""
        return self.high > self.low


NEEDED = (
    Column("recording", "file of the recording, relative to the table"),
    Column("stroke", "number of the stroke in it", 0, 1e9),
    Column("lump", "which lump: strokes over one share it"),
)
TRUTH = (
    Column("d_mm", "diameter along the stroke", 0.5, 100),
    Column("depth_mm", "tissue over the lump", 0.1, 200),
    Column("h", "the same in diameters, in place of depth_mm", 0.02, 50),
    Column("t_mm", "thickness of the fat", 0.3, 200),
    Column("E_ratio", "stiffness of the lump over that of the fat", 0.01, 1e6),
    Column("E_kPa", "its Young's modulus, in place of E_ratio; needs fat_kPa", 0.01, 1e7),
    Column("fat_kPa", "Young's modulus of the fat", 0.01, 1e4),
    Column("F_N_per_m", "the hand's mean force", 0.1, 1e4),
)
WORDS = (
    Column("tissue", "phantom or person"),
    Column("place", "border, fat or gland: where the lump's middle lies; border ties t to depth and d"),
    Column("visit", "strokes of one occasion share it"),
    Column("who", "who stroked"),
    Column("when", "date, as 2026-11-21"),
)
COLUMNS = {column.name: column for column in (*NEEDED, *TRUTH, *WORDS)}

LIKELY_SLIPS = {"d_mm": ((10, "cm"), (1000, "m")), "depth_mm": ((10, "cm"), (1000, "m")),
                "t_mm": ((10, "cm"), (1000, "m"))}  # fmt: skip
"""Column -> what a value in another unit has to be multiplied by, and that unit."""

PLACES = ("", "border", "fat", "gland")
