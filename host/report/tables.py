"""Table 1 and Appendices A to C as tables of text, thesis beside ours."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from palpate.learn.table import FEATURES, REFERENCE_CODE, relative
from palpate.learn.thesis.depth import THESIS, depth_choices
from palpate.learn.thesis.fit import ThesisFit
from palpate.learn.thesis.forward import OUTPUT_NAMES
from palpate.learn.thesis.runs import features_table
from palpate.learn.thesis.tables import STAR_FROM, Table1Entry, stars
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
    rows, marked = [], stars(fit.entries)
    for pressure, both, helps in zip(fit.entries[::2], fit.entries[1::2], marked[1::2]):
        row: dict[str, object] = {"": pressure.row.name}
        for head, entry in (("pressure", pressure), ("with displacement", both)):
            row[f"thesis, {head}"] = _r2(entry.thesis_r2, entry.thesis_star)
            row[f"ours, {head}"] = _r2(entry.direct.r2_in)
            row[f"left out, {head}"] = _r2(entry.direct.r2_loo, entry.displacement == helps)
            row[f"inverted, left out, {head}"] = _r2(entry.inverted_loo)
        row["n"] = str(pressure.n)
        rows.append(row)
    reached = sum(e.direct.r2_in >= e.thesis_r2 - 0.005 for e in fit.entries if e.thesis_r2 is not None)
    known = sum(e.thesis_r2 is not None for e in fit.entries)
    pairs = list(zip(fit.entries[::2], marked[1::2]))
    thesis_names, our_names = (
        ", ".join(dict.fromkeys(e.row.name for e, helps in pairs if (e.row.thesis_star, helps)[k]))
        for k in (0, 1)
    )
    return Item(
        "Table 1",
        "R2 of each input, from pressure alone and with displacement. The thesis' values are in sample, and "
        "ours stand beside them in sample and, harder, with every run left out of the fit that estimates it. "
        "The last of each four is the forward model inverted by least squares. A (*) marks the equation to "
        "use for an input: the thesis' by its R2 in sample; ours by that of runs left out, with displacement "
        f"only where it brings {STAR_FROM:g} or more. The thesis finds h better from pressure. In sample a "
        "further term can only help: its equation with displacement must leave out features of the map "
        "(which ones is lost), and ours does worse too where displacement takes the place of Base and "
        "Curvature (below, one linear term each).",
        [
            Beside("in-sample R2 reached (to .005)", f"{known} values", f"{reached} of {known}"),
            Beside("(*) with displacement", thesis_names, our_names),
            *(
                Beside(f"h (E >= 10) from {words}", _pair(thesis), _pair((every, hard)))
                for (words, every, hard), thesis in zip(depth_choices(fit.table), THESIS)
            ),
        ],
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
        "Every run with its inputs and outputs. The thesis' own table is lost: the codes are those that its "
        "text and Table 1 imply.",
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
    beside += [
        Beside(
            f"{OUTPUT_NAMES[name]} goes against physics",
            "not said",
            f"with {e.wrong_way_text()} of the range",
        )
        for name, e in fit.forward.items()
        if e.wrong_way
    ]
    tables = [(equation.text(), coefficients(equation.table)) for equation in fit.forward.values()]
    return Item(
        "Appendix B",
        "One equation for each output, its terms chosen by backward elimination: coefficient, standard "
        "error, t, P and "
        "variance inflation. Curvature takes one falling power of F, chosen among nine: a quadratic of ln F "
        "turned up again above F = .78. An equation is checked for its direction over the runs' whole range; "
        "where it goes the wrong way with an input, no run says how it should go, and it should not be used.",
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


def _pair(values: tuple[float | None, float | None]) -> str:
    return "" if values[0] is None else f"{_r2(values[0])} ({_r2(values[1])})"


def _r2(value: float | None, star: bool = False) -> str:
    return "" if value is None else f"{value:.3f}" + " *" * star
