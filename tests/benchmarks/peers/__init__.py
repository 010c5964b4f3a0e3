"""The stroke as other people's programs compute it: same geometry, material and load."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Peer:
    """What a peer made of the stroke: CPU seconds, displacement (n,), mm, and images (n, 16), kPa."""

    name: str
    nodes: int
    cpu_s: float
    displacement_mm: np.ndarray
    images_kPa: np.ndarray
