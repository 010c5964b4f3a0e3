"""The documents of the models that probes and recordings name.

A probe carries its model as an image, which holds only what the probe itself works out, but names the
training set. The document, model.json, is the one that the user names, or one that comes with Palpate.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Protocol

from firmware_py import messages, model_image
from palpate import models
from palpate.errors import CommandRefused
from palpate.model_export.schema import ModelSpec

HEAD = model_image.HEAD_SIZE


class ReadBack(Protocol):
    """A probe that can be asked for what it stores: `palpate.link.remote.Commandable`."""

    def read_back(self, what: int, enough: int | None = None) -> bytes:
        """The calibration or the model image; b"" where there is none."""


class Documents:
    """By the id of the image.

    Parameters
    ----------
    named : ModelSpec, optional
        The one that the user says belongs to the probe; it is taken where it does.
    """

    def __init__(self, named: ModelSpec | None = None) -> None:
        self._named = named
        self._known: dict[bytes, ModelSpec | None] = {}
        self._answering: bytes | None = None  # id of the model that answers; b"": not known, None: not asked

    def learn(self, image: bytes) -> None:
        """Look the document of this image up; its first `HEAD` bytes are enough. b"": there is none."""
        self._answering = b""
        if len(image) < HEAD:
            return
        head = model_image.Header(lambda at, n: image[at : at + n], model_image.u32(image, _LENGTH))
        if head.code == 0:
            self._answering = head.model_id
            self._known[head.model_id] = self._of(head.training.hex())

    def ask(self, probe: ReadBack) -> None:
        """Learn of the model that is live on a probe."""
        image = b""
        with suppress(CommandRefused):  # of a probe that only streams
            image = probe.read_back(messages.READ_MODEL, HEAD)
        self.learn(image)

    def of(self, model_id: bytes) -> ModelSpec | None:
        """The document of the image with this id; None if nobody has it."""
        return self._known.get(model_id)

    @property
    def answering(self) -> ModelSpec | None:
        """The document of the image that was learnt last; None if nobody has it."""
        return self._known.get(self._answering or b"")

    @property
    def remark(self) -> str:
        """What is to be said of the document that the user named, where the model that answers has another.

        The rest of a sentence that begins with its name; "" where there is nothing to say.
        """
        if self._named is None or self._answering is None:
            return ""
        if not self._answering:
            return f"is not used: no model image was found that it could belong to; {_UNTOLD}"
        own = self._known[self._answering]
        if own is self._named:
            return ""
        instead = _UNTOLD if own is None else "its own, which comes with Palpate, is used instead"
        return f"is not of the model that answers, and is not used: {instead}"

    def _of(self, training: str) -> ModelSpec | None:
        if self._named is not None and self._named.training["hash"] == training:
            return self._named
        return models.trained_on(training)


_UNTOLD = "width and place across, the layer, and why a stroke is outside what the model knows are not shown"
_LENGTH = 8
"""Where an image's head says how long it is."""
