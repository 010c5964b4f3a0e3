"""An emulator of frames over cylinders in the plane: a small network that was fitted to computed ones.

Rows and displacement of forty frames, and their derivatives, take 3 ms; the solver needs seconds. In fat of
any modulus: pressures are over the face's mean one, forces over the modulus. Units: mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import Case, Settings

Floats = NDArray[np.float64]
Small = NDArray[np.float32]

INPUTS = (
    "ln d", "ln depth", "ln t", "E^-2/3", "ln gland ratio", "ln gland", "b of the fat", "b of the gland",
    "ln R", "place", "ln F",
)  # fmt: skip
B_OF_THE_FAT, PLACE, FORCE = 6, 9, 10
LOW = np.array(
    [*np.log([3.5, 1.2, 3.0]), 0.01, *np.log([0.8, 7.0]), 0.0, 0.0, np.log(35.0), -36.0, np.log(0.15)]
)
HIGH = np.array(
    [*np.log([30.0, 35.0, 45.0]), 0.85, *np.log([12.0, 42.0]), 5.0, 5.0, np.log(45.5), 2.0, np.log(17.0)]
)
"""What it was fitted to; beyond it goes on along its tangent, and stays as it is far before the lump."""
ROWS = 16
MESH = Settings(hx_mm=0.5, shells=3, tolerance=1e-3, to_border=True)
"""Of the frames it was fitted to. The inversion sets it right on the same one: another reads otherwise."""
_STIFFENING = slice(B_OF_THE_FAT, B_OF_THE_FAT + 2)


@dataclass(frozen=True)
class PlaneEmulator:
    """Layers of weights (a, b) and biases (b,): swish between them, none behind the last.

    Attributes
    ----------
    weights, biases : tuples of ndarray, float32
    """

    weights: tuple[Small, ...]
    biases: tuple[Small, ...]

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        """Frames (n, 17) at inputs (n, 11): rows over the mean pressure, ln displacement; and (n, 17, 11)."""
        within = np.clip(x, LOW, HIGH)
        seen, steps = features(within)
        value: Small = seen.astype(self.weights[0].dtype)
        slopes: Small = np.ascontiguousarray(steps.transpose(2, 0, 1)).astype(value.dtype)
        for W, b in zip(self.weights[:-1], self.biases[:-1]):
            z = value @ W + b
            s = np.float32(0.5) * (1 + np.tanh(z / 2))
            slopes = (slopes.reshape(-1, len(W)) @ W).reshape(len(slopes), *z.shape)
            slopes *= s * (1 + z * (1 - s))
            value = z * s
        out: Floats = (value @ self.weights[-1] + self.biases[-1]).astype(float)
        by: Floats = (slopes @ self.weights[-1]).transpose(1, 2, 0).astype(float)
        beyond = x - within
        beyond[:, PLACE] = 0.0
        by[..., PLACE] *= (within[:, PLACE] == x[:, PLACE])[:, None]
        return out + np.einsum("nok,nk->no", by, beyond), by


def inputs_of(case: Case) -> Floats:
    """The first nine inputs."""
    return np.array([
        *np.log([case.d_mm, case.d_mm * case.h, case.t_mm]), case.E_inv23,
        *np.log([case.gland_ratio, case.gland_mm]), case.fat_stiffening, case.gland_stiffening,
        np.log(case.probe_radius_mm),
    ])  # fmt: skip


_MIDDLE, _SPREAD = (LOW + HIGH) / 2, (HIGH - LOW) / np.sqrt(12)


def features(x: Floats) -> tuple[Floats, Floats]:
    """What the network sees of inputs (n, 11): (n, m), and derivatives (n, m, 11).

    The inputs to one scale; how near the lump is; how its middle, its end and its size stand to border and
    depth.
    """
    n = len(x)
    out, by = np.empty((n, len(INPUTS) + 7)), np.zeros((n, len(INPUTS) + 7, len(INPUTS)))
    own = np.arange(len(INPUTS))
    out[:, own], by[:, own, own] = (x - _MIDDLE) / _SPREAD, 1 / _SPREAD
    stiff = np.sqrt(x[:, _STIFFENING] + 0.2)
    out[:, _STIFFENING] = 2 * stiff - 2.2
    by[:, own[_STIFFENING], own[_STIFFENING]] = 1 / stiff
    place, k = x[:, PLACE], len(INPUTS)
    for width in (6.0, 16.0):
        near = np.exp(-((place / width) ** 2) / 2)
        out[:, k], by[:, k, PLACE] = 2 * near - 1, -2 * near * place / width**2
        k += 1
    d, depth = np.exp(x[:, 0]), np.exp(x[:, 1])
    middle, end = depth + d / 2, depth + d
    for below, of_d, of_depth in (
        (np.log(middle) - x[:, 2], d / 2 / middle, depth / middle),
        (np.log(end) - x[:, 2], d / end, depth / end),
    ):
        step = np.tanh(2 * below)
        out[:, k] = step
        by[:, k, :3] = (2 * (1 - step**2))[:, None] * np.column_stack([of_d, of_depth, -np.ones(n)])
        k += 1
    out[:, k] = np.log(middle) - x[:, 2]
    by[:, k, :3] = np.column_stack([d / 2 / middle, depth / middle, -np.ones(n)])
    out[:, k + 1] = x[:, 1] - x[:, 0]
    by[:, k + 1, :2] = -1.0, 1.0
    size = d / middle
    out[:, k + 2] = size
    by[:, k + 2, :2] = np.column_stack([size * depth / middle, -size * depth / middle])
    return out, by


def write_plane_emulator(path: Path, emulator: PlaneEmulator) -> None:
    """Write it, weights as float32."""
    layers = {f"W{i}": W.astype(np.float32) for i, W in enumerate(emulator.weights)}
    layers |= {f"b{i}": b.astype(np.float32) for i, b in enumerate(emulator.biases)}
    with path.open("wb") as out:
        np.savez_compressed(out, allow_pickle=False, **layers)


def read_plane_emulator(path: Path) -> PlaneEmulator:
    """What `write_plane_emulator` has written."""
    with np.load(path) as file:
        count = len(file.files) // 2
        weights, biases = (tuple(file[f"{name}{i}"] for i in range(count)) for name in "Wb")
    return PlaneEmulator(weights, biases)
