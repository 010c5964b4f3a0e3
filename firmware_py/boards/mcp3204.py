"""Microchip MCP3204 behind a state machine: four channels of 12 bits, and the address of what comes next.

Data sheet DS21298E, section 5 and figure 5-1. Chip select goes low, then each bit takes a clock: start,
single-ended, D2 (not looked at), D1, D0 (the channel), one more; the input is sampled from the rise of D0's
clock to the fall of the next one. Then come a zero and twelve bits, the most significant first. At 3.3 V the
chip takes 1.2 MHz.

As soon as the sample is taken the multiplexers go on to the next cell: the amplifiers have the rest of this
conversion and the beginning of the next to settle, 17 us.
"""

import rp2

TYPE_CHECKING = False
if TYPE_CHECKING:  # the words of the assembler, which `asm_pio` puts into the program's reach
    from rp2.asm_pio import block, in_, jmp, label, nop, out, pins, pull, set, wrap, wrap_target, x, x_dec

MACHINE_HZ = 2000000  # two instructions a clock: 1 MHz; a conversion takes 41 of them

# side-set: bit 0 is the chip select, bit 1 the clock (1: let go; 0: low; 2: high)


@rp2.asm_pio(
    out_init=(rp2.PIO.OUT_LOW,) * 9,  # type: ignore[arg-type]
    set_init=rp2.PIO.OUT_LOW,
    sideset_init=(rp2.PIO.OUT_HIGH, rp2.PIO.OUT_LOW),  # type: ignore[arg-type]
    out_shiftdir=rp2.PIO.SHIFT_RIGHT,
    in_shiftdir=rp2.PIO.SHIFT_LEFT,
    autopush=True,
    push_thresh=12,
)
def conversions():
    """One conversion for each word (scan_order.order); out: address pins and DIN; set: DIN; in: DOUT."""
    wrap_target()
    pull(block).side(1)[1]  # between two conversions the chip wants to be let go for .5 us
    set(pins, 1).side(0)  # start
    nop().side(2)
    nop().side(0)  # single-ended
    nop().side(2)
    nop().side(0)  # D2
    nop().side(2)
    out(pins, 9).side(0)  # D1
    nop().side(2)
    out(pins, 9).side(0)  # D0
    nop().side(2)  # sampling begins
    set(x, 11).side(0)
    nop().side(2)
    nop().side(0)  # and ends
    out(pins, 9).side(2)  # the next address; the chip's zero goes by
    nop().side(0)
    label("bit")
    in_(pins, 1).side(2)
    jmp(x_dec, "bit").side(0)
    wrap()
