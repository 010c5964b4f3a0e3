"""What the commands for real strokes share: the model and the data set that are named."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.console import note

if TYPE_CHECKING:
    from palpate.dataset.table import DataSet
    from palpate.model_export.schema import ModelSpec

data_option = click.option("--data", required=True, type=click.Path(path_type=Path, dir_okay=False),
                           help="Table of recordings, strokes and truth.")  # fmt: skip
leave_out_option = click.option(
    "--leave-out", is_flag=True, help="Leave out lumps outside the model's ranges, instead of stopping."
)


def load_model(path: Path) -> ModelSpec:
    """The model of a file, or one that comes with Palpate by its name, as `field`."""
    from palpate import models
    from palpate.model_export.schema import ModelSpec

    return models.load(str(path)) if str(path) in models.NAMES and not path.exists() else ModelSpec.load(path)


def load_data(path: Path, spec: ModelSpec, leave_out: bool) -> DataSet:
    """The data set, its truths within the model's ranges; remarks go to standard error."""
    from palpate.dataset import answers, table

    data = table.read(path)
    if leave_out:
        inside = answers.check_ranges(data, spec)
        if not inside.all():
            n = int((~inside).sum())
            data = data.only(inside, f"{n} strokes over lumps outside the model's ranges were left out")
    answers.refuse_outside(data, spec)
    for remark in data.remarks:
        note(remark)
    return data
