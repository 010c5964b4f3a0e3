"""The first exchange on a line: who is there, and do we speak the same protocol?"""

from __future__ import annotations

import random

from palpate.errors import CommandRefused, CommandTimeout, LinkGone, NotAProbe, PortBusy
from palpate.link.line import Line
from palpate.wire.events import Log
from palpate.wire.identity import Identity


def shake_hands(line: Line) -> Identity:
    """The identity of the probe at the other end; the line keeps it.

    Raises
    ------
    NotAProbe
        The other end does not answer the handshake.
    PortBusy
        It says why it talks to nobody, and hangs up: another program is connected.
    VersionMismatch
        It speaks another protocol.
    """
    try:
        answer = line.ask("identify", (random.randrange(1 << 30),))
    except LinkGone as error:
        if words := _last_words(line):  # an emulated probe that serves another host
            raise PortBusy(line.transport.name, f"{line.transport.name} is busy: {words}") from error
        raise
    except (CommandTimeout, CommandRefused) as error:
        to_do = "check the port (`palpate devices`) and that the firmware runs"
        if words := _last_words(line):
            to_do = f"it says: {words}"
        raise NotAProbe(f"{line.transport.name} does not answer as a Palpate probe; {to_do}") from error
    identity = Identity.from_answer(answer.values)
    identity.check()
    line.identity = identity
    return identity


def _last_words(line: Line) -> str:
    """What a probe that cannot answer has logged: why its firmware does not start."""
    words = ""
    while (event := line.events.get(0)) is not None:
        words = event.text if isinstance(event, Log) else words
    return words
