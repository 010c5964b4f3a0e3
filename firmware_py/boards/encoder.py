"""An incremental encoder on two pins, counted by their interrupts; nothing is allocated."""

from machine import Pin, disable_irq, enable_irq

# what a change from state `before` to `now` (each A | B << 1) means, at before << 2 | now; 2: both
# changed at once
_STEP = bytes((0, 1, 255, 2, 255, 0, 2, 1, 1, 2, 0, 255, 2, 255, 1, 0))


class Encoder:
    """Counts quarter steps.

    Parameters: the pins of A and B; um_numerator / um_denominator: travel of a quarter step.
    `missed` counts edges that came too fast to tell their direction: the position is then wrong, and
    known to be.
    """

    def __init__(self, a: Pin, b: Pin, um_numerator: int, um_denominator: int = 1) -> None:
        self._a = a.value
        self._b = b.value
        self._numerator = um_numerator
        self._denominator = um_denominator
        self._state = self._a() | self._b() << 1
        self.steps = 0
        self.missed = 0
        edges = Pin.IRQ_RISING | Pin.IRQ_FALLING
        a.irq(self._edge, edges, hard=True)
        b.irq(self._edge, edges, hard=True)

    def _edge(self, _pin: Pin) -> None:
        now = self._a() | self._b() << 1
        step = _STEP[self._state << 2 | now]
        self._state = now
        if step == 1:
            self.steps += 1
        elif step == 255:
            self.steps -= 1
        elif step == 2:
            self.missed += 1

    def position_um(self) -> int:
        """Travel since the start or the last `zero`."""
        return self.steps * self._numerator // self._denominator

    def zero(self) -> None:
        """Here is 0."""
        state = disable_irq()
        self.steps = 0
        enable_irq(state)
