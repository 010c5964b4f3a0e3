"""A board that is up, copied as often as one likes: what is done to a copy the board never hears of.

The whole process is copied (fork), emulator and all, in a few milliseconds; a start takes twenty seconds.
"""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable
from typing import TypeVar

from palpate.errors import PalpateError

T = TypeVar("T")


class CopyFailed(PalpateError):
    """What was done to the copy ended with an error; the message is its traceback."""


def in_a_copy(work: Callable[[], T]) -> T:
    """Do this in a copy of the process and of every board in it.

    Parameters
    ----------
    work
        Threads that it needs it starts itself: of those that run, none is copied.

    Returns
    -------
    What it gave, by pickle.

    Raises
    ------
    CopyFailed
        It raised an error, or ended otherwise.
    """
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(ours)
        try:
            answer = pickle.dumps((work(), None))
        except BaseException:
            answer = pickle.dumps((None, traceback.format_exc()))
        with os.fdopen(theirs, "wb") as out:
            out.write(answer)
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours, "rb") as answers:
        said = answers.read()
    os.waitpid(child, 0)
    if not said:
        raise CopyFailed("the copy ended without a word")
    value, wrong = pickle.loads(said)  # our own words, from our own copy
    if wrong:
        raise CopyFailed(wrong)
    return value  # type: ignore[no-any-return]
