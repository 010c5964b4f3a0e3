"""The emulated probe: what its sensors read of a stroke, the runtimes that carry the firmware.

And faults on its link.
"""
