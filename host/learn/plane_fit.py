"""Fits the emulator of frames in the plane to computed frames and their derivatives.

Each step sees some frames, and of each its derivative by one of the inputs: values and slopes are matched
alike (Czarnecki and others, Sobolev training for neural networks, 2017), by Adam (Kingma and Ba 2015).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.learn.plane_emulator import HIGH, INPUTS, LOW, PLACE, PlaneEmulator, features
from palpate.progress import ProgressCallback, Steps

Small = NDArray[np.float32]
Ints = NDArray[np.int64]

_WIDTH, _LAYERS = 256, 4
_PASSES, _BATCH = 600, 256
_RATE, _LAST_RATE, _WARM_UP = 3e-3, 1e-5, 500
_UNIT = 0.01
"""Errors of rows over the mean pressure, and of ln displacement, count in this."""
_OUTLIER = 3.0
"""Errors of more units count less than their square."""
_GAIN = np.float32(30.0)
"""What comes out of the last layer is of order one times that."""
_REACH = (HIGH - LOW) / np.sqrt(48)
_REACH[PLACE] = 3.0
"""An error of a derivative counts as it tells on so long a step of its input."""


@dataclass(frozen=True)
class Frames:
    """Computed frames: inputs (n, 11), values (n, 17) as the emulator gives them, derivatives (n, 17, 11)."""

    x: Small
    y: Small
    slopes: NDArray[np.float16]

    def some(self, which: NDArray[np.bool_]) -> Frames:
        """These of them."""
        return Frames(self.x[which], self.y[which], self.slopes[which])


def fit_plane_emulator(
    frames: Frames, passes: int = _PASSES, progress: ProgressCallback | None = None
) -> PlaneEmulator:
    """The emulator of these frames; the same frames give the same."""
    rng = np.random.default_rng(0)
    seen, of_inputs = (one.astype(np.float32) for one in features(frames.x.astype(float)))
    mean = frames.y.mean(0)
    wanted = ((frames.y - mean) / np.float32(_UNIT)).astype(np.float32)
    reach = _REACH.astype(np.float32)
    net = _Network((seen.shape[1], *[_WIDTH] * _LAYERS, wanted.shape[1]), rng)
    batches = len(seen) // _BATCH
    adam = _Adam(net.parameters, passes * batches)
    steps = Steps("Passes over all frames", passes, progress)
    for done in range(passes):
        order = rng.permutation(len(seen))
        for part in np.array_split(order[: batches * _BATCH], batches):
            by = rng.integers(0, len(INPUTS), len(part))
            along = of_inputs[part, :, by] * reach[by, None]
            steeper = frames.slopes[part, :, by].astype(np.float32) * (reach[by, None] / np.float32(_UNIT))
            value, slope = net.forward(seen[part], along)
            adam.step(net.backward(_pull(value - wanted[part]), _pull(slope - steeper)))
        steps(str(done))
    last = _GAIN * np.float32(_UNIT)
    *weights, W = net.weights
    *biases, b = net.biases
    return PlaneEmulator((*weights, W * last), (*biases, (b.astype(float) * last + mean).astype(np.float32)))


def errors_of(emulator: PlaneEmulator, frames: Frames, cases: Ints) -> dict[str, float]:
    """What it gets wrong of frames of these cases, per cent: rows (of their mean, rms), and displacement."""
    wrong = 100 * (emulator(frames.x.astype(float))[0] - frames.y)
    rows = [float(np.sqrt((wrong[cases == k, :-1] ** 2).mean())) for k in np.unique(cases)]
    return {
        "rows, the median case": float(np.median(rows)),
        "rows, nine cases in ten": float(np.quantile(rows, 0.9)),
        "displacement, the median": float(np.median(np.abs(wrong[:, -1]))),
    }


def _pull(error: Small) -> Small:
    """The loss' derivative by a value, for a batch."""
    out: Small = error / np.sqrt(1 + (error / np.float32(_OUTLIER)) ** 2) / np.float32(_BATCH)
    return out


class _Network:
    """Values and one directional derivative of each, forward and backward."""

    def __init__(self, sizes: Sequence[int], rng: np.random.Generator) -> None:
        shapes = list(pairwise(sizes))
        scale = [np.sqrt((1.8 if i else 1.0) / a) for i, (a, _) in enumerate(shapes)]
        scale[-1] *= 0.1
        self.weights = [
            (s * rng.standard_normal(shape)).astype(np.float32) for s, shape in zip(scale, shapes)
        ]
        self.biases = [np.zeros(b, np.float32) for _, b in shapes]

    @property
    def parameters(self) -> list[Small]:
        """Weights, then biases."""
        return [*self.weights, *self.biases]

    def forward(self, value: Small, slope: Small) -> tuple[Small, Small]:
        """Outputs (n, outputs) for features (n, m), and their derivatives along directions (n, m)."""
        self._kept = []
        last = len(self.weights) - 1
        for i, (W, b) in enumerate(zip(self.weights, self.biases)):
            z, dz = value @ W + b, slope @ W
            if i == last:
                self._kept.append((value, slope, z, dz, z))
                break
            s = 0.5 * (1 + np.tanh(z / 2))
            first, second = s * (1 + z * (1 - s)), s * (1 - s) * (2 + z * (1 - 2 * s))
            self._kept.append((value, slope, first, second, dz))
            value, slope = z * s, first * dz
        return _GAIN * z, _GAIN * dz

    def backward(self, of_value: Small, of_slope: Small) -> list[Small]:
        """The loss' derivatives by `parameters`, from those by the last outputs."""
        weights: list[Small] = []
        biases: list[Small] = []
        g, h = _GAIN * of_value, _GAIN * of_slope
        for i in range(len(self.weights) - 1, -1, -1):
            value, slope, first, second, dz = self._kept[i]
            if i < len(self.weights) - 1:
                g, h = g * first + h * second * dz, h * first
            weights.insert(0, value.T @ g + slope.T @ h)
            biases.insert(0, g.sum(0))
            g, h = g @ self.weights[i].T, h @ self.weights[i].T
        return [*weights, *biases]


class _Adam:
    """Its rate rises from nothing, then falls along half a cosine."""

    def __init__(self, parameters: list[Small], steps: int) -> None:
        self._parameters, self._steps, self._done = parameters, steps, 0
        self._mean = [np.zeros_like(p) for p in parameters]
        self._square = [np.zeros_like(p) for p in parameters]

    def step(self, slopes: Sequence[Small]) -> None:
        """Change the parameters, in place."""
        self._done += 1
        fall = 0.5 * (1 + np.cos(np.pi * self._done / self._steps))
        rate = _RATE * min(1.0, self._done / _WARM_UP) * fall + _LAST_RATE
        for p, slope, mean, square in zip(self._parameters, slopes, self._mean, self._square):
            mean += 0.1 * (slope - mean)
            square += 0.01 * (slope * slope - square)
            first, second = 1 - 0.9**self._done, 1 - 0.99**self._done
            p -= (rate * (mean / first) / (np.sqrt(square / second) + 1e-8)).astype(np.float32)
