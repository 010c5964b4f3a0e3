"""`const`: MicroPython's compiler puts a module's own numbers in as they stand; elsewhere it does nothing."""

try:
    from micropython import const
except ImportError:

    def const(number):  # type: ignore[misc]
        """The number itself."""
        return number
