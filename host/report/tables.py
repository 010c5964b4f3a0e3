"""Table 1 and Appendices A to C as tables of text, thesis beside ours."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from palpate.regression.runs import features_table
from palpate.regression.table import FEATURES, REFERENCE_CODE, relative
from palpate.regression.thesis.fit import ThesisFit
from palpate.regression.thesis.forward import OUTPUT_NAMES
from palpate.regression.thesis.table_1 import Table1Entry
from palpate.report.items import Beside, Item
from palpate.sim.tissue import Stroke

_RUN_COLUMNS = {
    "code": "code", "F_rel": "F", "t_mm": "t (mm)", "d_mm": "d (mm)", "h": "h", "E_ratio": "E",
    "base_kPa": "Base (kPa)", "amp_kPa": "Amp (kPa)", "stdev_mm": "Stdev (mm)", "curvature": "Curvature",
    "D28_mm": "D28 (mm)", "D0_mm": "D0 (mm)",
}  # fmt: skip


def items(fit: ThesisFit, strokes: Sequence[Stroke]) -> list[Item]:
    """Table 1 and Appendices A, B and C."""
    return [table_1(fit), appendix_a(strokes), appendix_b(fit), appendix_c(fit)]


def table_1(fit: ThesisFit) -> Item:
    """The complete inverse model."""
    rows = []
    for pressure, both in zip(fit.entries[::2], fit.entries[1::2]):
        row: dict[str, object] = {"": pressure.row.name}
        for head, entry in (("pressure", pressure), ("with displacement", both)):
            row[f"thesis, {head}"] = _r2(entry.thesis_r2)
            row[f"ours, {head}"] = _r2(entry.direct.r2_in)
            row[f"left out, {head}"] = _r2(entry.direct.r2_loo)
            row[f"inverted, left out, {head}"] = _r2(entry.inverted_loo)
        row["n"] = str(pressure.n)
        rows.append(row)
    reached = sum(e.direct.r2_in >= e.thesis_r2 - 0.005 for e in fit.entries if e.thesis_r2 is not None)
    known = sum(e.thesis_r2 is not None for e in fit.entries)
    return Item(
        "Table 1",
        "Summary of the complete Inverse Model",
        "R2 of each input, from pressure alone and with displacement. The thesis' values are in sample, and "
        "ours stand "
        "beside them in sample and, harder, with every run left out of the fit that estimates it. The last "
        "of each four "
        "is the forward model inverted by least squares.",
        [Beside("in-sample R2 reached (to .005)", f"{known} values", f"{reached} of {known}")],
        tables=[("", pd.DataFrame(rows))],
    )


def appendix_a(strokes: Sequence[Stroke]) -> Item:
    """Raw data of the runs, absolute and relative."""
    table = features_table(strokes)
    shown = pd.DataFrame({"code": table["code"]})
    for name in list(_RUN_COLUMNS)[1:]:
        shown[_RUN_COLUMNS[name]] = [f"{v:.4g}" for v in table[name]]
    tables = [("Inputs and outputs", shown)]
    if REFERENCE_CODE in set(table["code"]):
        ratio = relative(table)
        relative_table = pd.DataFrame({"code": table["code"]})
        for name in FEATURES:
            relative_table[_RUN_COLUMNS[name].split(" (")[0]] = [f"{v:.4f}" for v in ratio[name]]
        tables.append((f"Relative to {REFERENCE_CODE}", relative_table))
    return Item(
        "Appendix A",
        "Raw Data from Simulations",
        "Every run with its inputs and outputs. The thesis' own table is lost: the codes are those that its "
        "text and "
        "Table 1 imply.",
        [
            Beside(
                "runs",
                "30, of which 29 linear",
                f"{len(table)}, of which {int(table['linear'].sum())} linear",
            )
        ],
        tables=tables,
    )


def appendix_b(fit: ThesisFit) -> Item:
    """Regression analysis of the forward model."""
    beside = [
        Beside(f"{OUTPUT_NAMES[name]}, R2 (adjusted)", "almost 1", f"{e.r2:.4f} ({e.r2_adjusted:.4f})")
        for name, e in fit.forward.items()
    ]
    tables = [(equation.text(), coefficients(equation.table)) for equation in fit.forward.values()]
    return Item(
        "Appendix B",
        "Regression Analysis Results for the Forward Model",
        "One equation for each output, its terms chosen by backward elimination: coefficient, standard "
        "error, t, P and "
        "variance inflation.",
        beside,
        tables=tables,
    )


def appendix_c(fit: ThesisFit) -> Item:
    """Regression analysis of the inverse model."""
    beside = [
        Beside(
            _which(entry),
            _r2(entry.thesis_r2),
            f"{entry.direct.r2_in:.3f}; left out {entry.direct.r2_loo:.3f}",
        )
        for entry in fit.entries
    ]
    tables = [(f"{_which(e)}: {e.direct.text()}", coefficients(e.direct.table)) for e in fit.entries]
    return Item(
        "Appendix C",
        "Regression Analysis Results for the Inverse Model",
        "One equation for each input and each choice of data: the best subset of terms, by leave-one-out "
        "error.",
        beside,
        tables=tables,
    )


def coefficients(table: pd.DataFrame) -> pd.DataFrame:
    """A table of coefficients as text."""
    shown = table.reset_index(names="term")
    for name in shown.columns[1:]:
        digits = "{:.1e}" if str(name).startswith("P") else "{:.4g}"
        shown[name] = ["" if pd.isna(v) else digits.format(v) for v in shown[name]]
    return shown.rename(columns=lambda name: str(name).replace("_", " "))


def _which(entry: Table1Entry) -> str:
    return f"{entry.row.name}, {'with displacement' if entry.displacement else 'pressure'}"


def _r2(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
