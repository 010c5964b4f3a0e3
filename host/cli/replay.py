"""`palpate replay`: a recording through the live parser and the probe's own integer code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from palpate.cli.ports import document_option, estimate_lines, fat_option, visit_lines
from palpate.cli.real import load_model
from palpate.console import json_option, note, print_json, say
from palpate.errors import RecordingError, ReplayDiffers
from palpate.files import read_whole
from palpate.first_time import announce


@click.command("replay")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--model", type=click.Path(path_type=Path), help="A model image to use instead of the recorded one."
)
@document_option
@fat_option
@json_option
def command(
    recording: Path, model: Path | None, document: Path | None, fat_kPa: float | None, as_json: bool
) -> None:
    """Replay a recording: the same bytes through the same parser and the same integer code.

    Says "replay: identical" where every integer of every estimate equals what the probe had sent; exits with
    status 1 where one differs, or where nothing could be compared. A probe without a model, as other people's
    arrays are, gets its estimates here: give the --model.

    \b
    Example:
      palpate stream --strokes 1 --record visit.mcap
      palpate replay visit.mcap
    """
    from palpate.answer.visit import visit_answer
    from palpate.model_export.image_builder import inspect
    from palpate.recording.channels import MODEL
    from palpate.recording.reader import Recording
    from palpate.stroke.documents import Documents
    from palpate.stroke.replay import replay

    image = read_whole(model, "model image") if model is not None else None
    opened = Recording(recording)
    documents = Documents(None if document is None else load_model(document))
    documents.learn(image or opened.attachment(MODEL) or b"")
    if documents.remark:
        note(f"{document} {documents.remark}")
    announce(solver=False, firmware=True)
    strokes = []
    for stroke in replay(recording, image, documents):
        strokes.append(stroke)
        if not as_json:
            say("\n".join(estimate_lines(stroke.answer, fat_kPa, stroke.told)))
            if stroke.alone:
                say(f"  by model {stroke.answer.model_id.hex()}, here: the probe had none")
            else:
                say(f"  replay: {stroke.missing or ('identical' if stroke.identical else 'DIFFERENT')}")
    together = visit_answer([(stroke.answer, stroke.told) for stroke in strokes])
    if not as_json and together is not None:
        say("\n".join(visit_lines(together, fat_kPa)))
    alone = sum(stroke.alone for stroke in strokes)
    compared = [stroke for stroke in strokes if stroke.host is not None and not stroke.alone]
    image = image or opened.attachment(MODEL)
    adapted = inspect(image).adapted if image and (compared or alone) else ""
    summary: dict[str, Any] = {
        "recording": recording,
        "adapted": adapted,
        "finished": opened.finished,
        "identical": bool(compared) and all(stroke.identical for stroke in compared),
        "compared": len(compared),
        "alone": alone,
        "strokes": [stroke.as_dict() for stroke in strokes],
        "together": None if together is None else together.as_dict(),
    }
    if as_json:
        print_json(summary)
    if damage := opened.check():
        note(damage)
    if not opened.finished:
        note(f"{recording} has no end (its writer was stopped); it was read up to its last complete frame")
    if any(not stroke.identical for stroke in compared):
        raise ReplayDiffers(f"the replay of {recording} differs from what the probe sent; report it")
    if not compared and not alone:
        why = strokes[0].missing if strokes else "it holds no estimate"
        raise RecordingError(f"nothing in {recording} can be compared: {why}")
    if not as_json and adapted:
        say(f"the model was {adapted}")
    if not as_json and compared:
        say(f"replay: identical ({len(compared)} of {len(strokes)} strokes compared)")
