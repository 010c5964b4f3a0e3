"""The report: results of the thesis that the data can make, in its numbering, beside its values.

from palpate.report import write_report
write_report("report/", strokes=read_strokes("runs/"), thesis=fit_thesis(...))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.report.writer import write_report

__all__ = ["write_report"]


def __getattr__(name: str) -> Any:
    """`write_report`, imported when it is used: matplotlib is heavy."""
    if name != "write_report":
        raise AttributeError(name)
    from palpate.report.writer import write_report

    return write_report
