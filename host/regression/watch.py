"""How long work tells of its progress."""

from __future__ import annotations

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Called now and then with what is being done, how much of it is done, and how much there is."""
