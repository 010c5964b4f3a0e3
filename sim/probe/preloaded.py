"""A model that an emulated probe has from the start: put into its store by the firmware's own code."""

from __future__ import annotations

from firmware_py import features, slots, status
from firmware_py.store import FileStore
from palpate.errors import PalpateError

_PIECE = 1024


class NotTaken(PalpateError):
    """The firmware refused the model; the message says with which status."""


def preload(store: FileStore, public_key: bytes, image: bytes) -> None:
    """Make a signed model the live one of a probe that is switched off; a probe that has one keeps it.

    Parameters
    ----------
    store : FileStore
        The probe's flash memory.
    public_key : bytes
        Whose models the probe accepts.
    image : bytes
        As `palpate export` writes it.

    Raises
    ------
    NotTaken
        The firmware refuses it; the store keeps the model that it had.
    """
    mine = slots.Slots(store, public_key, features.FEATURES_VERSION, features.COUNT)
    if mine.boot() == status.OK:
        return
    mine.settle()
    code = mine.begin(len(image))
    for at in range(0, len(image), _PIECE):
        if code == status.OK:
            code = mine.write(at, image[at : at + _PIECE])
    for step in (mine.verify, mine.try_, mine.confirm):
        if code == status.OK:
            code = step()
    if code != status.OK:
        raise NotTaken(f"the emulated probe cannot begin with this model: status {code}; export it again")
