"""`palpate demo`: the whole chain on its embedded defaults, from tissue to an answer on the probe.

Each step is what a user's own command does (sweep, fit, export, emulate, flash, stream); nothing is
faked between them. `chain` runs them, `picture` draws the one figure.
"""

from host.demo.chain import DemoResult, run

__all__ = ["DemoResult", "run"]
