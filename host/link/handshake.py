"""The first question on a line: who is there, and do we speak the same protocol."""

from __future__ import annotations

import random

from host.errors import CommandRefused, CommandTimeout, NotAProbe
from host.link.identity import Identity
from host.link.line import Line


def shake_hands(line: Line) -> Identity:
    """Who answers at the other end of a line, which knows it from here on.

    Raises
    ------
    NotAProbe
        The other end does not answer the handshake.
    VersionMismatch
        It speaks another protocol.
    """
    try:
        answer = line.ask("identify", (random.randrange(1 << 30),))
    except (CommandTimeout, CommandRefused) as error:
        raise NotAProbe(
            f"{line.transport.name} does not answer as a Palpate probe; check the port (`palpate devices`) "
            "and that the firmware runs"
        ) from error
    identity = Identity.from_answer(answer.values)
    identity.check()
    line.identity = identity
    return identity
