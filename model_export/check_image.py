"""Can a model image be read? Asked before it goes to a probe, or into a replay."""

from __future__ import annotations

import struct

from firmware_py import keyring
from firmware_py.model_image import MAGIC
from palpate.errors import ImageUnreadable

_BODY_AT = 8
"""Where an image says how long it is, without its signature (docs/model-image.md)."""


def is_succession(image: bytes) -> bool:
    """Whether this is no model but another key, signed by the one before it (`palpate keygen --succeeds`)."""
    return image.startswith(keyring.SUCCESSION)


def check_image(image: bytes, outcome: str = "nothing was sent to the probe") -> str:
    """The id of a model image that can be read; nothing is sent to a probe for it.

    Parameters
    ----------
    image : bytes
        As `palpate export` writes it.
    outcome : str
        How the error's text ends.

    Raises
    ------
    ImageUnreadable
        It is no model image, is cut short, or needs what this version does not know.
    """
    from palpate.model_export.errors import ImageError
    from palpate.model_export.image_builder import inspect

    if is_succession(image):
        return keyring.name(image[len(keyring.SUCCESSION) :]).hex()
    try:
        if image.startswith(MAGIC) and (body := struct.unpack_from("<I", image, _BODY_AT)[0]) > len(image):
            raise ImageError(f"the model image is cut short: {len(image)} bytes of more than {body}")
        return inspect(image).model_id
    except ImageError as error:
        raise ImageUnreadable(f"{error}; {outcome}") from error
    except (IndexError, ValueError, KeyError, struct.error, MemoryError, OverflowError) as error:
        message = "the model image is damaged (it cannot be read to its end); export it again"
        raise ImageUnreadable(message) from error
