"""The field model's results as tables for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from host.regression.field.score import ordered
from host.regression.table import TARGETS

if TYPE_CHECKING:
    from host.regression.field.fit import FieldFit


def field_tables(fit: FieldFit) -> list[Table]:
    """Held-out table, coverage, flags and exclusions, detectability, two visits."""
    return [_held_out(fit), _coverage(fit), _facts(fit), _excluded(fit), _found(fit), _visits(fit)]


def _held_out(fit: FieldFit) -> Table:
    out = Table(title="Held-out lumps: R2 / median error")
    for name in (
        "noise",
        "model",
        "strokes",
        "terms",
        "t",
        "d",
        "h",
        "E^-2/3",
        "hard/soft",
        "far from 10",
        "n",
    ):
        out.add_column(name, justify="left" if name in ("noise", "model") else "right")
    for row in fit.rows:
        s = row.scores
        cells = [f"{s[f'{t}_r2']:.3f} / {100 * s[f'{t}_error']:.1f} %" for t in ("t", "d", "h")]
        cells += [
            f"{s['E_inv23_r2']:.3f}",
            f"{100 * s['hard_soft']:.1f} %",
            f"{100 * s['hard_soft_far']:.1f} %",
        ]
        out.add_row(row.noise, row.recipe, str(row.strokes), str(row.terms), *cells, f"{s['n']:.0f}")
    missed = fit.missed_targets()
    out.caption = "all targets met" if not missed else "missed: " + "; ".join(missed)
    return out


def _coverage(fit: FieldFit) -> Table:
    level = 100 * fit.model.widths.level
    out = Table(title=f"Coverage of the {level:.0f} % interval (median half-width), noise {fit.noise}")
    out.add_column("lumps")
    for name in ("F", "t", "d", "h", "E^-2/3", "n"):
        out.add_column(name, justify="right")
    for group, row in fit.coverage.iterrows():
        cells = []
        for t in TARGETS:
            half = row[f"half_{t}"]
            cells.append(
                f"{100 * row[t]:.1f} ({half:.3f})"
                if t == "E_inv23"
                else f"{100 * row[t]:.1f} ({100 * half:.1f} %)"
            )
        out.add_row(str(group), *cells, f"{row['n']:.0f}")
    return out


_WORDS = {
    "decided": "hard or soft said, not unsure",
    "wrong_of_decided": "wrong of these",
    "hard_called_soft": "hard lumps called soft",
    "soft_called_hard": "soft lumps called hard",
    "E_is_a_bound": "E given as a lower bound",
    "flagged_inside": "lumps in the training ranges flagged as out of domain",
    "flagged_outside": "lumps outside them flagged",
    "flagged_or_at_an_end_inside": "lumps in the ranges flagged, or with an estimate at the end of its range",
    "flagged_or_at_an_end_outside": "lumps outside flagged, or with an estimate at the end of its range",
    "outside_no_lump": "lumps outside not found",
    "outside_warned_in_all": "lumps outside not found, flagged, or at the end of a range",
    "false_alarms": "plain tissue taken for a lump",
}


def _facts(fit: FieldFit) -> Table:
    out = Table(title=f"Flags, noise {fit.noise}")
    out.add_column("")
    out.add_column("share", justify="right")
    for name, words in _WORDS.items():
        if name in fit.facts:
            out.add_row(words, f"{100 * fit.facts[name]:.1f} %")
    out.add_row("median of that bound", f"E >= {fit.facts['median_bound']:.1f}")
    return out


def _excluded(fit: FieldFit) -> Table:
    out = Table(title="Left out")
    out.add_column("why")
    out.add_column("strokes", justify="right")
    for why, n in fit.excluded.items():
        out.add_row(why, str(n))
    return out


def _found(fit: FieldFit) -> Table:
    out = Table(title="Lumps found, %, by d (mm), h and E")
    E_ranges = ordered(fit.found["E"])
    for name in ("d", "h", *(f"E {e}" for e in E_ranges)):
        out.add_column(name, justify="right")
    share = fit.found.set_index(["d_mm", "h", "E"])["found"].to_dict()
    for d in ordered(fit.found["d_mm"]):
        for h in ordered(fit.found["h"]):
            cells = [share.get((d, h, e)) for e in E_ranges]
            out.add_row(d, h, *("" if c is None else f"{100 * c:.0f}" for c in cells))
    return out


def _visits(fit: FieldFit) -> Table:
    out = Table(title="Smallest change of diameter that two visits of one stroke tell apart")
    out.add_column("lumps")
    out.add_column("change", justify="right")
    for row in fit.visits.to_dict("records"):
        out.add_row(str(row["group"]), f"{row['percent']:.1f} %")
    return out
