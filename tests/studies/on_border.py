"""As `inverted`, over lumps on the border of fat and gland in unknown tissue, and fitted as such."""

from __future__ import annotations

from palpate.inversion.classes import BORDER
from tests.studies import inverted
from tests.studies.table import Asked, StudyTable


def tables(asked: Asked) -> list[StudyTable]:
    """Invert what is not yet there; then accuracy, and factors from one half for the other."""
    return inverted.tables(asked, BORDER.name)
