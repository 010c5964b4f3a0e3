"""A rigid face pressed on a felupe body and slid over it, in the plane or in space: contact, Newton's method.

felupe has no sliding contact with a face of this shape, nor a force on one; these are brought to it. The
y axis points up; the body's last point is the probe, whose second value is its height. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Callable

import cvxopt
import numpy as np
from cvxopt import cholmod
from felupe import FieldContainer, SolidBodyNearlyIncompressible
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, tril

PENALTY = 600.0
"""Of the contact, kPa/mm: the probe sinks in by .2 % of the displacement. Half or twice as
much, and some moves of 2 mm must be halved."""

_TOLERANCE = 1e-4  # of the force, at any node
_LIMIT = 25

Face = Callable[[NDArray], tuple[NDArray, NDArray, NDArray]]
"""Height (n,), slopes (n, k) and curvatures (n, k) of the face at places (n, k) in its own frame."""


class PenaltyContact:
    """Nodes of the surface against the face.

    A node that touches stays while the last linear step leaves it under pressure.

    Parameters
    ----------
    nodes, places_mm, areas : ndarray (n,), (n, dim), (n,)
        Of the surface, undeformed.
    values : ndarray (N, dim)
        The field's own, which Newton's method changes.
    """

    def __init__(
        self, nodes: NDArray, places_mm: NDArray, areas: NDArray, values: NDArray, face: Face
    ) -> None:
        self.nodes, self.X, self.areas, self.values, self.face = nodes, places_mm, areas, values, face
        self.dim = values.shape[1]
        self.sideways = [0, 2][: self.dim - 1]
        self.dofs = self.dim * nodes[:, None] + np.arange(self.dim)
        self.height = values.size - self.dim + 1
        self.active = np.zeros(len(nodes), bool)

    def look(self, position: float) -> tuple[NDArray, NDArray, NDArray]:
        """How deep each node lies in the probe (n,), normals (n, dim) and curvatures (n, dim - 1)."""
        x = self.X + self.values[self.nodes]
        aside = x[:, self.sideways]
        aside[:, 0] -= position
        height, slopes, curvatures = self.face(aside)
        normals = np.ones_like(x)
        normals[:, self.sideways] = -slopes
        return x[:, 1] - self.X[:, 1] - self.values[-1, 1] - height, normals, curvatures

    def forces(self, gap: NDArray) -> NDArray:
        """Of the probe on the nodes, upwards positive where it pulls."""
        return gap * PENALTY * self.areas * self.active

    def vector(self, force: float, pull: NDArray, normals: NDArray) -> NDArray:
        """What is out of balance: at the nodes, and of the `force` on the probe."""
        r = np.zeros(self.values.size)
        r[self.dofs] = pull[:, None] * normals
        r[self.height] = force - pull.sum()
        return r

    def matrix(self, pull: NDArray, normals: NDArray, curvatures: NDArray) -> csr_matrix:
        """Its derivative."""
        k = PENALTY * self.areas * self.active
        border = np.full(len(k), self.height)
        block = k[:, None, None] * normals[:, :, None] * normals[:, None, :]
        block[:, self.sideways, self.sideways] -= np.maximum(pull, 0.0)[:, None] * curvatures
        rows, columns, entries = [border], [border], [k]
        for a in range(self.dim):
            rows += [self.dofs[:, a], border]
            columns += [border, self.dofs[:, a]]
            entries += [-k * normals[:, a]] * 2
            for b in range(self.dim):
                rows.append(self.dofs[:, a])
                columns.append(self.dofs[:, b])
                entries.append(block[:, a, b])
        places = np.concatenate(rows), np.concatenate(columns)
        return coo_matrix((np.concatenate(entries), places), 2 * (self.values.size,)).tocsr()


class Sliding:
    """Body, contact and Newton's method.

    Parameters
    ----------
    held : ndarray (N, dim), bool
        Held degrees of freedom of all points but the probe's.
    force : float
        On the probe.
    """

    def __init__(
        self,
        field: FieldContainer,
        body: SolidBodyNearlyIncompressible,
        contact: PenaltyContact,
        held: NDArray,
        force: float,
    ) -> None:
        self.field, self.body, self.contact, self.force = field, body, contact, force
        self.values = field[0].values
        free = np.zeros(self.values.shape, bool)
        free[:-1], free[-1, 1] = ~held, True
        self.free = np.nonzero(free.ravel())[0]
        self.iterations = 0

    @property
    def depth_mm(self) -> float:
        """How far the probe has sunk."""
        return -float(self.values[-1, 1])

    def balance(self, position: float, by_force: bool = True) -> None:
        """Newton's method: for all that is free, or all but the probe's height."""
        contact = self.contact
        free = self.free if by_force else self.free[self.free != contact.height]
        gap, normals, curvatures = contact.look(position)
        contact.active |= gap > 0
        for _ in range(_LIMIT):
            pull = contact.forces(gap)
            r = contact.vector(self.force, pull, normals)
            r += self.body.assemble.vector(self.field).toarray().ravel()
            error = np.abs(r[free]).max()
            if error < _TOLERANCE * self.force:
                return
            if not error < 1e3 * self.force:
                break
            # Without the field it goes on with the pressures of the last step; given it, they would be put
            # back to what the displacements say, and moves of more than half a millimetre would diverge.
            K = self.body.assemble.matrix()
            step = np.zeros(self.values.size)
            try:
                whole = K + contact.matrix(pull, normals, curvatures)
                step[free] = _solve(whole[free][:, free], -r[free])
            except ArithmeticError:  # far from balance the face's curvature can destroy definiteness
                flat = K + contact.matrix(pull, normals, 0.0 * curvatures)
                step[free] = _solve(flat[free][:, free], -r[free])
            step = step.reshape(self.values.shape)
            linear = gap + (normals * step[contact.nodes]).sum(1) - step[-1, 1]
            self.values += step
            gap, normals, curvatures = contact.look(position)
            contact.active = np.where(contact.active, linear > 0, gap > 0)
            self.iterations += 1
        raise ArithmeticError("no convergence")

    def press(self, position: float, lowered_mm: float) -> None:
        """Lower the probe until it bears the force, each time from a straight line through the last two."""
        before = self.values.copy()
        while self.contact.forces(self.contact.look(position)[0]).sum() < 0.9 * self.force:
            here = self.values.copy()
            self.values += here - before
            self.values[-1, 1] = here[-1, 1] - lowered_mm
            before = here
            self.balance(position, by_force=False)
        self.balance(position)

    def move(self, here: float, there: float) -> None:
        """Slide under the force; what fails is done in halves."""
        values, active, body = self.values.copy(), self.contact.active.copy(), self.body.checkpoint()
        try:
            self.balance(there)
        except (ArithmeticError, RuntimeError):
            if there - here < 1 / 32:
                raise
            self.body.restore(body)
            self.values[:], self.contact.active = values, active
            self.move(here, (here + there) / 2)
            self.move((here + there) / 2, there)


def _solve(K: csr_matrix, b: NDArray) -> NDArray:
    """CHOLMOD (cvxopt), supernodal: made for what is symmetric and dense in parts.

    Raises
    ------
    ArithmeticError
        The matrix is not positive definite.
    """
    cholmod.options["supernodal"] = 2
    lower = tril(K).tocoo()
    A = cvxopt.spmatrix(
        cvxopt.matrix(lower.data),
        cvxopt.matrix(lower.row.astype(np.int64)),
        cvxopt.matrix(lower.col.astype(np.int64)),
        lower.shape,
    )
    factor = cholmod.symbolic(A, uplo="L")
    cholmod.numeric(A, factor)
    x = cvxopt.matrix(b)
    cholmod.solve(factor, x)
    return np.array(x).ravel()
