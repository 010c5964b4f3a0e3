"""Stand-ins for a forward model where the posterior is a formula."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Nothing:
    """What is predicted, and how: the toy's misfit needs neither."""

    far: float = 0.0
    scale: float = 1.0
    unsure: float = 0.0

    def __call__(self, *_):
        return self

    def slopes(self, _):
        return self

    def on_mesh_of(self, _):
        return False

    def away(self, theta):
        return self.far * float(np.hypot(*theta))

    def set_right(self, *_):
        raise AssertionError("nothing more is asked")
