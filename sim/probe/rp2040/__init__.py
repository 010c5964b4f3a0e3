"""The reference probe's board: an emulated RP2040 (the package rp2040py) under MicroPython's own port."""
