"""`palpate demo`: the whole chain on its embedded defaults, from tissue to an answer on the probe.

Each step is what a user's own command does (sweep, fit, export, emulate, flash, stream); nothing is
faked between them. `steps` runs them, `picture` draws the one figure.
"""

from palpate.demo.steps import DemoResult, run

__all__ = ["DemoResult", "run"]
