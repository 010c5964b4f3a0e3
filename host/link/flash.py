"""Putting a model image onto the probe: begin, data, verify, confirm, read back.

The probe trusts nothing before `verify` (signature, versions, self-test) and keeps its old model until
`confirm`, so that a cut at any moment leaves a model that works. Every piece can be sent again;
after a cut the transfer goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import logging
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from firmware_py import messages, status
from palpate.errors import CommandRefused, FlashError, ImageRefused, LinkError, LinkGone
from palpate.link.probe import Probe
from palpate.model_export.check_image import check_image, is_succession

_log = logging.getLogger(__name__)

BACK_TRIES = 100
"""Steps back, without progress, after which a probe is not followed any further; a restart is one."""
VERIFY_TIMEOUT_S = 60.0
"""A small probe needs seconds for SHA-256 over its image; the command is harmless to repeat."""

REFUSALS = {
    status.BAD_SIGNATURE: "its signature does not fit (the file was changed, or another key signed it)",
    status.BAD_PROBE: "it was made for another probe",
    status.BAD_VERSION: "it has a format this firmware does not know; update the firmware",
    status.MISSING_FEATURE: "it needs a feature this firmware does not compute; update the firmware",
    status.SELF_TEST: "it failed the self-test on the probe",
    status.NO_SPACE: "it does not fit into the probe",
    status.BAD_MAGIC: "it is not a model image",
    status.BAD_CRC: "it is damaged; export it again",
    status.BAD_MODEL: "it holds a number that no model can have; export it again",
}

_HEAD = struct.Struct("<12x2I")
"""An image's counter, and what it may replace (docs/model-image.md)."""


@dataclass(frozen=True)
class Flashed:
    """The result of a flash: the live model's id (hex), bytes sent, pieces that had to be sent again."""

    model_id: str
    size: int
    resumed_at: int


def flash(probe: Probe, image: bytes, progress: Callable[[int, int], None] | None = None) -> Flashed:
    """Make `image` the live model of a probe.

    Parameters
    ----------
    probe : Probe
        Live, past its handshake.
    image : bytes
        A signed model image (docs/model-image.md).
    progress : callable, optional
        Called with bytes done and bytes in all.

    Returns
    -------
    Flashed
        With the id that the probe now gives in its handshake.

    Raises
    ------
    ImageRefused
        The probe refused it; its old model stays.
    FlashError
        The probe went away for good, or reports the image live but gives another id.
    """
    check_image(image)
    if probe.identity.model_status == status.NO_KEY:
        raise ImageRefused(
            "no public key: the probe holds no key.pub, so it takes no model; "
            "`palpate board DIRECTORY --key KEY` makes its files with one"
        )
    if "flash" not in probe.identity.capabilities:
        raise ImageRefused("this probe's firmware is built without flashing; see docs/firmware.md")
    try:
        start = _begin(probe, image)
        made_ready = _transfer(probe, image, start, progress)
        probe.command("flash_confirm", made_ready, timeout_s=VERIFY_TIMEOUT_S)
    except CommandRefused as refusal:
        why = REFUSALS.get(
            refusal.status, f"{refusal.reason} (status {refusal.status}, at {refusal.command})"
        )
        if refusal.status == status.BAD_PROBE:
            why = f"it was made for {made_for(image)!r}, and this probe's array is {probe.identity.array!r}"
        if refusal.status == status.TOO_OLD:
            why = _too_old(probe, image)
        message = f"the probe refused the model image: {why}; the model it had stays"
        raise ImageRefused(message, refusal.status) from refusal
    except LinkGone as gone:
        message = f"{gone.args[0].split(';')[0]}; the model it had stays: plug it in and flash again to go on"
        raise FlashError(message) from gone
    live = probe.refresh_identity()
    _log.info("flashed %d bytes from byte %d on: model %s", len(image) - start, start, live.model_id)
    if live.model_id != made_ready.hex() and not is_succession(image):
        raise FlashError(
            f"the probe confirmed model {made_ready.hex()} but answers with "
            f"{live.model_id or 'none'}; flash it again"
        )
    return Flashed(live.model_id, len(image), start)


def held_counter(probe: Probe) -> int:
    """The security counter that an image must reach: the live model's, or what it may replace; 0 without."""
    head = probe.read_back(messages.READ_MODEL, _HEAD.size)
    if len(head) < _HEAD.size:
        return 0
    counter, replaces = _HEAD.unpack_from(head)
    return int(max(counter, replaces))


def _too_old(probe: Probe, image: bytes) -> str:
    if is_succession(image):
        return "it is older than the succession that the probe took last; make it again"
    own, _ = _HEAD.unpack_from(image)
    why = f"it is older than a model the probe has held (its counter is {own})"
    held = 0
    with suppress(LinkError):
        held = held_counter(probe)
    if held <= own:
        return f"{why}; export it again"
    return (
        f"{why[:-1]}, the probe's {held}); export it again or, where the other was signed by a clock that "
        f"ran ahead, or an older model is wanted, with --rollback --counter {held}"
    )


def _transfer(probe: Probe, image: bytes, at: int, progress: Callable[[int, int], None] | None) -> bytes:
    """Send the image from `at` on and have it verified; the id of the model that it made ready."""
    best, back = at, 0
    while at < len(image):
        if progress is not None:
            progress(at, len(image))
        before, at = at, _send_piece(probe, image, at)
        back = 0 if at > best else back + (at <= before)
        best = max(best, at)
        if not 0 <= at <= len(image) or back > BACK_TRIES:
            raise FlashError(
                f"{probe.name} does not keep what it is sent (it says that it has {at} bytes); the model it "
                "had stays: reset the probe and flash it again"
            )
    if progress is not None:
        progress(at, len(image))
    return bytes(probe.command("flash_verify", _name(image), timeout_s=VERIFY_TIMEOUT_S)[0])


def made_for(image: bytes) -> str:
    """The array that a model image names."""
    return image[24:40].rstrip(b"\0").decode("ascii", "replace")


def _name(image: bytes) -> bytes:
    """What the image is called while it is on its way: the probe goes on only with the same."""
    return hashlib.sha256(image).digest()[:8]


def _begin(probe: Probe, image: bytes) -> int:
    """Announce the image; how much of it the probe has already."""
    return int(probe.command("flash_begin", len(image), _name(image))[0])


def _send_piece(probe: Probe, image: bytes, at: int) -> int:
    """Send the piece at `at`; return how far the probe is (after a restart it may be behind)."""
    try:
        piece = image[at : at + messages.FLASH_PIECE]
        return int(probe.command("flash_data", at, tail=piece)[0])
    except CommandRefused as refusal:
        if refusal.status not in (status.BAD_STATE, status.BAD_VALUE):
            raise
        # The probe was reset in between and waits for a new beginning; it says how much it kept.
        return _begin(probe, image)
