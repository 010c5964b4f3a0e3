"""The emulated probe: what its sensors read during a stroke, the runtimes that run the firmware, faults on
its link.
"""
