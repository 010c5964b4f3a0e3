"""How well a guess explains a stroke over a solid lump: rows and pairs of columns instead of rows alone.

As `posterior`, but every bin's own gain and zero are taken out of the data beforehand: with B their effect on
a bin's weighted residuals r (n,), r is replaced by (1 + B B^T)^-1/2 r, which has the same density. What a
row's cells share of gain is an unknown. Beside the white noise a bin has what the mesh gets wrong: a part of
the steps to its neighbours.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Laid
from palpate.inversion.classes import Class
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import Emulated, Slopes
from palpate.inversion.posterior import EMULATED, Misfit, Posterior, Wrong
from palpate.inversion.solid_emulator import BINS
from palpate.sim.probe.noise import Noise
from palpate.wire.cells import FULL_SCALE_KPA, PITCH_MM

Floats = NDArray[np.float64]

_STEP_ERROR, _SHARE_ERROR = 0.02, 0.002
"""What the mesh gets wrong: of the steps to the next rows and columns, and of the pressure itself.

By pairs of strokes on the usual mesh and on columns of 1.4 mm."""
_COLUMN_ERROR, _ROW_ERRORS = 0.006, (0.3, 0.15)
"""Of the pressure in the outermost columns, and in the two outermost rows.

Where the contact ends, one mesh is 2 to 3 % off another, in all frames alike. Counted as noise of that size
it would lead d astray by 7 % and the width by 9 %."""
_SHARED = 10.0
"""A press' columns and frames err alike, at the edge of the contact: a hundred bins count as one there."""


def binned(stroke: FeltStroke) -> FeltStroke:
    """The stroke with the means of `BINS` for rows, (n, bins); one without a live cell counts for nothing."""
    assert stroke.image_kPa is not None
    n = len(stroke.image_kPa)
    pairs = stroke.image_kPa.reshape(n, *BINS, 2)
    live = np.isfinite(pairs[0]).sum(-1)
    mean = np.where(np.isfinite(pairs), pairs, 0.0).sum(-1) / np.maximum(live, 1)
    return replace(stroke, rows_kPa=mean.reshape(n, -1), live=live.ravel())


class SolidPosterior(Posterior):
    """One stroke, `binned`, under one class of solid lumps; a guess is a vector z of all unknowns.

    Parameters
    ----------
    alike : int
        So many strokes are over that lump: what the mesh gets wrong is alike in all, and no stroke more
        makes up for it.
    """

    own_zeros = False

    def __init__(self, of: Class, stroke: FeltStroke, noise: Noise, alike: int = 1) -> None:
        self._alike = alike
        super().__init__(of, stroke, noise, EMULATED)
        self._whiten = self._whitening()

    def _gain_sd(self) -> Floats:
        shared = self.noise.row_gain
        return np.full(BINS[0] if shared else 0, shared)

    def _weights(self, _: Wrong) -> Floats:
        s, noise = self.stroke, self.noise
        p = np.maximum(s.rows_kPa, 0.0).reshape(-1, *BINS)
        white, depth = self._sensors(np.maximum(s.live, 0.25))
        steps = np.zeros_like(p)
        for axis in (1, 2):
            apart = np.abs(np.diff(p, axis=axis))
            for part in (
                np.pad(apart, [(0, 0), *((0, int(axis == a)) for a in (1, 2))]),
                np.pad(apart, [(0, 0), *((int(axis == a), 0) for a in (1, 2))]),
            ):
                steps = np.maximum(steps, part)
        share = np.full(BINS, np.hypot(_SHARE_ERROR, noise.hysteresis))
        share[:, [0, -1]] = np.hypot(share[:, [0, -1]], _COLUMN_ERROR)
        for k, of_row in enumerate(_ROW_ERRORS):
            share[[k, -1 - k]] = np.hypot(share[[k, -1 - k]], of_row)
        mesh = np.sqrt(self._alike) * np.hypot(_STEP_ERROR * steps, share * p).reshape(len(p), -1)
        mesh[: s.press] *= _SHARED
        rows = np.maximum(np.sqrt(white**2 + mesh**2 + s.curve_kPa**2), 1e-3)
        weight = 1.0 / np.column_stack([rows, depth])
        weight[:, :-1] *= s.live > 0
        return weight

    def _whitening(self) -> Floats:
        """(bins, n, n): what takes each bin's own gain and zero out of its weighted residuals."""
        s, noise = self.stroke, self.noise
        live = np.maximum(s.live, 1)
        gain = noise.gain / np.sqrt(live)
        zero = noise.offset * FULL_SCALE_KPA / np.sqrt(live)
        weight = self._weight[:, :-1]
        B = np.stack([s.rows_kPa * gain * weight, zero * weight], -1).transpose(1, 0, 2)
        U, size, _ = np.linalg.svd(B, full_matrices=False)
        less = 1 - 1 / np.sqrt(1 + size**2)
        out: Floats = np.eye(len(weight)) - np.einsum("bik,bk,bjk->bij", U, less, U, optimize=True)
        return out

    def _white(self, residual: Floats) -> Floats:
        """Weighted residuals (n, bins + 1) without what a bin's gain and zero explain."""
        rows = np.einsum("bij,jb->ib", self._whiten, residual[:, :-1], optimize=True)
        return np.column_stack([rows, residual[:, -1]])

    def felt_N_per_m(self) -> Floats:
        """The force on each row of cells, all in all."""
        force: Floats = self.stroke.rows_kPa.sum(1) / BINS[1] * PITCH_MM
        return force

    def misfit(self, z: Floats, found: Emulated) -> Misfit:  # type: ignore[override]
        """Of a guess and its emulated frames."""
        plain = super().misfit(z, found)  # type: ignore[arg-type]
        return Misfit(self._white(plain.data), plain.prior)

    def jacobian(self, z: Floats, found: Emulated, slopes: Slopes) -> tuple[Floats, Floats]:  # type: ignore[override]
        """Of the misfit's data (n (bins + 1), size) and prior, as `Posterior.jacobian`."""
        data, prior = super().jacobian(z, found, slopes)  # type: ignore[arg-type]
        n = len(found.depth)
        data = data.reshape(n, -1, self.size)
        rows = np.matmul(self._whiten, data[:, :-1].transpose(1, 0, 2)).transpose(1, 0, 2)
        return np.concatenate([rows, data[:, -1:]], 1).reshape(-1, self.size), prior

    def by_row(self, data: Floats) -> Floats:
        """Root mean squares of each row's bins, and the displacement's residuals, (n, rows + 1)."""
        rows = np.sqrt((data[:, :-1] ** 2).reshape(-1, *BINS).mean(2))
        return np.column_stack([rows, data[:, -1]])

    def laid(self, z: Floats, found: Emulated) -> Laid:  # type: ignore[override]
        """The fitted stroke over the measured one, row by row."""
        s, fitted = self.stroke, self.predicted(z, found)
        rows, of = (one.reshape(-1, *BINS).mean(2) for one in (s.rows_kPa, fitted[:, :-1]))
        return Laid(s.place_mm, s.press, rows, of, s.displacement_mm, fitted[:, -1])
