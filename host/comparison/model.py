"""The model that two recordings are compared by, unless another is named: the one that was on the probe."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import RecordingError
from palpate.model_export.schema import ModelSpec
from palpate.recording.channels import MODEL
from palpate.recording.reader import Recording
from palpate.stroke.documents import Documents

_NAME_IT = "name one with --model, as --model balls or --model model.json"


def recorded_model(path: Path) -> ModelSpec:
    """The document of the model that answered in a recording.

    Raises
    ------
    RecordingError
        The recording has no model image, or nobody here has the document of its model.
    """
    image = Recording(path).attachment(MODEL)
    if not image:
        raise RecordingError(f"{path} does not say which model was on the probe; {_NAME_IT}")
    documents = Documents()
    documents.learn(image)
    if documents.answering is None:
        raise RecordingError(f"the model in {path} is none of those that come with Palpate; {_NAME_IT}")
    return documents.answering


def common_model(first: Path, second: Path) -> ModelSpec:
    """The same of two recordings.

    Raises
    ------
    RecordingError
        As above, or the recordings have different models.
    """
    models = [recorded_model(path) for path in (first, second)]
    if models[0].training["hash"] != models[1].training["hash"]:
        raise RecordingError(f"{first} and {second} were recorded with different models; {_NAME_IT}")
    return models[0]
