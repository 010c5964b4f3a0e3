"""Several strokes over one lump: one tissue and lump, and each stroke's own places, forces, zeros and gains.

Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Laid
from palpate.inversion.forward import Predicted, Slopes
from palpate.inversion.posterior import Misfit, Posterior

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHARED = ("tissue", "ln_E")


class Together:
    """The posterior of several strokes; a guess z has what they share, then each stroke's own numbers.

    Parameters
    ----------
    parts : sequence of Posterior
        Of one class, each with a stroke of its own.
    shared : tuple of str
        What else they share, of the names of `Posterior.at`.
    """

    def __init__(self, parts: Sequence[Posterior], shared: tuple[str, ...] = ()) -> None:
        self.parts = tuple(parts)
        first = self.parts[0]
        self.of = first.of
        self._common = np.concatenate([np.r_[first.at[name]] for name in (*_SHARED, *shared)])
        self._known = np.append(self._common, -1)  # and what the padding's owner says
        self.index: list[Ints] = []
        size = len(self._common)
        for part in self.parts:
            index = np.full(part.size, -1)
            index[self._common] = np.arange(len(self._common))
            own = np.flatnonzero(index < 0)
            index[own] = size + np.arange(len(own))
            size += len(own)
            self.index.append(index)
        self._in_order = len(self.parts) == 1 and np.array_equal(self.index[0], np.arange(size))
        """One stroke's own unknowns are all, as they stand."""
        k = first.at["tissue"].stop
        self.size, self.at = size, {"tissue": first.at["tissue"], "ln_E": slice(k, k + 1)}
        self.sd = self.joined([part.sd for part in self.parts])
        ends = np.cumsum([0, *(len(part.stroke.displacement_mm) for part in self.parts)])
        self._frames = [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def measured(self) -> int:
        """How many numbers were."""
        return sum(part.measured for part in self.parts)

    def joined(self, own: Sequence[Floats]) -> Floats:
        """One guess of the strokes' own; what they share is the first one's."""
        z = np.empty(self.size)
        for values, index in reversed(list(zip(own, self.index))):
            z[index] = values
        return z

    def start(self, theta: Floats, E_kPa: float, lumps_mm: Sequence[float]) -> Floats:
        """As `Posterior.start`; the lump lies elsewhere along each stroke."""
        return self.joined([part.start(theta, E_kPa, at) for part, at in zip(self.parts, lumps_mm)])

    def within(self, z: Floats) -> Floats:
        """A guess with tissue and lump no farther than the search goes."""
        out, at = z.copy(), self.at["tissue"]
        out[at] = self.of.within(z[at])
        return out

    def places(self, z: Floats) -> Floats:
        """Of all frames of all strokes, from the lump, mm."""
        return np.concatenate([part.places(z[index]) for part, index in zip(self.parts, self.index)])

    def forces(self, z: Floats) -> Floats:
        """Of all frames of all strokes in fat of 10 kPa, N/m."""
        return np.concatenate([part.forces(z[index]) for part, index in zip(self.parts, self.index)])

    def misfit(self, z: Floats, found: Predicted) -> Misfit:
        """Of all strokes; what is known of their tissue counts once."""
        each = [
            part.misfit(z[index], _some(found, frames))
            for part, index, frames in zip(self.parts, self.index, self._frames)
        ]
        prior = [one.prior if i == 0 else np.delete(one.prior, self._known) for i, one in enumerate(each)]
        return Misfit(np.concatenate([one.data for one in each]), np.concatenate(prior))

    def jacobian(self, z: Floats, found: Predicted, slopes: Slopes) -> tuple[Floats, Floats]:
        """Of the misfit's data and prior, as `Posterior.jacobian`."""
        data: list[Floats] = []
        prior: list[Floats] = []
        for i, (part, index, frames) in enumerate(zip(self.parts, self.index, self._frames)):
            own = Slopes(slopes.images[frames], slopes.depth[frames])
            A, B = part.jacobian(z[index], _some(found, frames), own)
            data.append(A)
            prior.append(B if i == 0 else np.delete(B, self._known, 0))
        return self._wide(data), self._wide(prior)

    def _wide(self, blocks: Sequence[Floats]) -> Floats:
        """The strokes' blocks below each other, each by its own unknowns."""
        if self._in_order:
            return blocks[0]
        out = np.zeros((sum(map(len, blocks)), self.size))
        ends = np.cumsum([0, *map(len, blocks)])
        for block, index, a, b in zip(blocks, self.index, ends, ends[1:]):
            out[a:b, index] = block
        return out

    def laid(self, z: Floats, found: Predicted) -> tuple[Laid, ...]:
        """Of each stroke, the fitted one over the measured one."""
        return tuple(
            part.laid(z[index], _some(found, frames))
            for part, index, frames in zip(self.parts, self.index, self._frames)
        )

    def seen(self, z: Floats, change: Floats) -> Floats:
        """As `Posterior.seen`, of all strokes."""
        return np.concatenate([
            part.seen(z[index], change[frames])
            for part, index, frames in zip(self.parts, self.index, self._frames)
        ])  # fmt: skip


def _some(found: Predicted, frames: slice) -> Predicted:
    """One stroke's frames of all."""
    return replace(
        found,
        places_mm=found.places_mm[frames],
        forces_N_per_m=found.forces_N_per_m[frames],
        images=found.images[frames],
        depth=found.depth[frames],
    )
