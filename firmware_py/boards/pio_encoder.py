"""An incremental encoder counted by a PIO state machine: no edge is lost, whatever the interpreter does.

The program fills a PIO block's 32 instructions. So it lies at address 0, where its table of jumps must be.
"""

from array import array

import rp2
from machine import Pin

TYPE_CHECKING = False
if TYPE_CHECKING:  # and the words of the assembler, which `asm_pio` puts into the program's reach
    from rp2.asm_pio import (
        in_,
        invert,
        irq,
        isr,
        jmp,
        label,
        mov,
        noblock,
        nop,
        pc,
        pins,
        push,
        rel,
        x,
        y,
        y_dec,
    )

    from firmware_py.boards.encoder import Encoder

SAMPLE_HZ = (
    1000000  # a look at the pins takes 7 to 11 of these cycles: an edge every 12 us is followed, 2 m/s
)
_FIFO = 4  # words that may be old when one begins to read


@rp2.asm_pio(in_shiftdir=rp2.PIO.SHIFT_LEFT)
def quarter_steps():
    """Count in y, modulo 2**32; x holds the pins as they were (bit 0: A, bit 1: B)."""
    # Address = pins before << 2 | pins now. A leads B on the way up: 00, 01, 11, 10 (B, A).
    jmp("tell")
    jmp("up")
    jmp("down")
    jmp("lost")
    jmp("down")
    jmp("tell")
    jmp("lost")
    jmp("up")
    jmp("up")
    jmp("lost")
    jmp("tell")
    jmp("down")
    jmp("lost")
    jmp("down")
    jmp("up")
    jmp("tell")
    label("lost")  # both have changed at once
    irq(rel(0))
    jmp("tell")
    label("up")  # there is only counting down: it counts the inverse down, and inverts again
    mov(y, invert(y))
    jmp(y_dec, "risen")
    label("risen")
    mov(y, invert(y))
    jmp("tell")
    label("down")
    jmp(y_dec, "tell")
    label("tell")
    mov(isr, y)
    push(noblock)  # a full queue keeps its old words; ISR is empty afterwards
    in_(x, 2)
    in_(pins, 2)
    mov(x, isr)
    mov(pc, isr)
    nop()
    nop()
    nop()


class PioEncoder:
    """Counts quarter steps; the same members as encoder.Encoder.

    Parameters: the pins of A and B, which must be neighbours (B = A + 1), set up as inputs; um_numerator /
    um_denominator: travel of a quarter step; machine: number of the state machine.
    `missed` counts edges that came too fast to tell their direction.

    The machine's count is read modulo 2**16: the position must be asked for at least every 32767 steps.
    """

    def __init__(self, a: Pin, b: Pin, um_numerator: int, um_denominator: int = 1, machine: int = 0) -> None:
        self._numerator = um_numerator
        self._denominator = um_denominator
        self._words = array("H", bytes(2 * (_FIFO + 1)))
        self._last = 0
        self.steps = 0
        self.missed = 0
        self._machine = rp2.StateMachine(machine, quarter_steps, freq=SAMPLE_HZ, in_base=a)
        self._get = self._machine.get
        # what the pins are now, so that the first look is no step
        self._machine.exec("set(y, 0)")
        self._machine.exec("in_(pins, 2)")
        self._machine.exec("mov(x, isr)")
        self._machine.irq(self._lost, hard=True)
        self._machine.active(1)

    def _lost(self, _machine: "rp2.StateMachine") -> None:
        self.missed += 1

    def _take(self) -> None:
        words = self._words
        self._get(words)  # the last of them was written after the first was read: it is new
        now = words[_FIFO]
        self.steps += ((now - self._last + 32768) & 65535) - 32768
        self._last = now

    def position_um(self) -> int:
        """Travel since the start or the last `zero`. Allocates nothing."""
        self._take()
        return self.steps * self._numerator // self._denominator

    def zero(self) -> None:
        """Here is 0."""
        self._take()
        self.steps = 0


def best(a: Pin, b: Pin, um_numerator: int, um_denominator: int = 1) -> "PioEncoder | Encoder":
    """The wheel, counted by PIO block 0; by the pins' interrupts where that has no room (OSError)."""
    try:
        return PioEncoder(a, b, um_numerator, um_denominator)
    except OSError:
        from firmware_py.boards import encoder

        return encoder.Encoder(a, b, um_numerator, um_denominator)
