"""The stroke as other people's programs compute it: same geometry, material and load."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Peer:
    """What a peer made of the stroke: CPU seconds, displacement (n,), mm, and images (n, 16), kPa.

    `iterations` are linear solutions, also those of attempts that failed.
    """

    name: str
    nodes: int
    cpu_s: float
    displacement_mm: np.ndarray
    images_kPa: np.ndarray
    iterations: int


QUARTERS = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
"""Nodes of the four-node cells that a nine-node element is cut into."""
