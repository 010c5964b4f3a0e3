"""Where the fronts of the multifrontal factorisation get their numbers from, worked out once for a mesh.

A front is the dense symmetric matrix of a branch of the tree: first its pivots' degrees of freedom, then its
border's. Its pivot rows stay as the factor; what is left of its border is added to its parent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid.mesh import SolidMesh
from palpate.sim.tissue.solid.tree import Branch, dissect

Ints = NDArray[np.int64]
Narrow = NDArray[np.int32]


@dataclass(frozen=True)
class Fronts:
    """Index tables of all fronts, one after the other; `*_start` (fronts + 1,) says where each one's begin.

    Attributes
    ----------
    size, pivots : ndarray (fronts,)
        Order of the front, and how many of it are eliminated.
    parent : ndarray (fronts,)
        -1 at the root.
    dofs, dofs_start : ndarray
        Degrees of freedom of the front's rows.
    panel_start : ndarray (fronts + 1,)
        Where the pivot rows, (pivots, size), are stored.
    corner_start : ndarray (fronts,)
        Where the square of the rest stands until the parent has taken it.
    corners : int
        How much room these squares take, one in place of another.
    child, child_start : ndarray
    element, element_start : ndarray
        Elements that are assembled here.
    element_rows : ndarray (M, 81)
        Rows of the front for the elements in the order of `element`; -1 where held.
    up : ndarray
        Rows of the parent for the front's border, one front after the other at `up_start`.
    run, run_start : ndarray
        Where in `up` (of each front, from 0) rows cease to be neighbours: begins of runs, and the end.
    contact, contact_start : ndarray
        Surface nodes whose contact stiffness is assembled here.
    contact_rows : ndarray (S, 3)
        Rows of the front for each surface node.
    front_of_element, front_of_contact : ndarray
    """

    size: Ints
    pivots: Ints
    parent: Ints
    dofs: Ints
    dofs_start: Ints
    panel_start: Ints
    corner_start: Ints
    corners: int
    child: Ints
    child_start: Ints
    element: Ints
    element_start: Ints
    element_rows: Narrow
    up: Ints
    up_start: Ints
    run: Ints
    run_start: Ints
    contact: Ints
    contact_start: Ints
    contact_rows: Narrow
    front_of_element: Ints
    front_of_contact: Ints

    @property
    def work(self) -> NDArray[np.float64]:
        """Multiplications and additions of each front's elimination, two flops each counted (fronts,)."""
        n, p = self.size.astype(float), self.pivots.astype(float)
        return p * n * n - p * p * n + p**3 / 3


def lay_fronts(mesh: SolidMesh) -> Fronts:
    """Dissect a mesh and index its fronts."""
    free = np.logical_not(mesh.fixed)
    centres = mesh.nodes_mm[mesh.elements].mean(1)
    tree = dissect(mesh.elements, centres, np.asarray(free.any(1)))
    skin = mesh.surface.ravel()
    pivot_dofs = [_dofs(branch.pivots, free) for branch in tree]
    border_dofs = [_dofs(branch.border, free) for branch in tree]
    pivots = np.array([len(d) for d in pivot_dofs])
    size = pivots + np.array([len(d) for d in border_dofs])
    rest = size - pivots

    parent = np.full(len(tree), -1)
    row = np.full(free.size, -1)
    element_dofs = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(-1, 81)
    on_skin = np.full(len(free), -1)
    on_skin[skin] = np.arange(len(skin))
    front_of_element = np.empty(len(mesh.elements), np.int64)
    front_of_contact = np.full(len(skin), -1)
    contact_rows = np.full((len(skin), 3), -1, np.int32)
    element_rows, contacts = [], []
    up: list[Ints] = [np.empty(0, np.int64)] * len(tree)
    for i, branch in enumerate(tree):
        dofs = np.concatenate([pivot_dofs[i], border_dofs[i]])
        row[dofs] = np.arange(len(dofs))
        for child in branch.children:
            parent[child] = i
            up[child] = row[border_dofs[child]]
        element_rows.append(row[element_dofs[branch.elements]].astype(np.int32))
        front_of_element[branch.elements] = i
        here = _new_contacts(branch, mesh, on_skin, front_of_contact)
        front_of_contact[here] = i
        contact_rows[here] = row[3 * skin[here, None] + np.arange(3)]
        contacts.append(here)
        row[dofs] = -1
    runs = [_runs(rows) for rows in up]
    corner_start, corners = _stacked(rest * rest, [branch.children for branch in tree], parent)
    return Fronts(
        size=size,
        pivots=pivots,
        parent=parent,
        dofs=np.concatenate([d for pair in zip(pivot_dofs, border_dofs) for d in pair]),
        dofs_start=starts(size),
        panel_start=starts(pivots * size),
        corner_start=corner_start,
        corners=corners,
        child=_joined([np.array(branch.children, np.int64) for branch in tree]),
        child_start=starts([len(branch.children) for branch in tree]),
        element=_joined([branch.elements for branch in tree]),
        element_start=starts([len(branch.elements) for branch in tree]),
        element_rows=np.concatenate(element_rows),
        up=_joined(up),
        up_start=starts([len(rows) for rows in up]),
        run=_joined(runs),
        run_start=starts([len(rows) for rows in runs]),
        contact=_joined(contacts),
        contact_start=starts([len(some) for some in contacts]),
        contact_rows=contact_rows,
        front_of_element=front_of_element,
        front_of_contact=front_of_contact,
    )


def _dofs(nodes: Ints, free: NDArray[np.bool_]) -> Ints:
    return (3 * nodes[:, None] + np.arange(3))[free[nodes]]


def _new_contacts(branch: Branch, mesh: SolidMesh, on_skin: Ints, front_of_contact: Ints) -> Ints:
    """Surface nodes of a bottom branch that no other front has taken."""
    if branch.children:
        return np.empty(0, np.int64)
    here = on_skin[np.unique(mesh.elements[branch.elements])]
    here = here[here >= 0]
    return here[front_of_contact[here] < 0]


def _runs(rows: Ints) -> Ints:
    if not len(rows):
        return np.zeros(1, np.int64)
    return np.concatenate([[0], np.nonzero(np.diff(rows) != 1)[0] + 1, [len(rows)]])


def _stacked(lengths: Ints, children: list[list[int]], parent: Ints) -> tuple[Ints, int]:
    """Where to put what each front passes up, and the room for all.

    Two stacks grow towards each other, for even and odd depths: a front's own comes where its grandchildren's
    were, while its children's are on top of the other.
    """
    depth = np.zeros(len(lengths), np.int64)
    for f in range(len(lengths) - 2, -1, -1):
        depth[f] = depth[parent[f]] + 1
    place = np.zeros(len(lengths), np.int64)
    height, most = [0, 0], 0
    for f, side in enumerate(depth % 2):
        place[f] = height[side]
        height[side] += int(lengths[f])
        most = max(most, sum(height))
        height[1 - side] -= int(lengths[children[f]].sum())
    from_the_end = depth % 2 == 1
    place[from_the_end] = most - place[from_the_end] - lengths[from_the_end]
    return place, most


def starts(lengths: Ints | list[int]) -> Ints:
    """Where each of some stretches of these lengths begins, one after the other, and the end."""
    return np.concatenate([[0], np.cumsum(np.asarray(lengths, np.int64))])


def _joined(parts: list[Ints]) -> Ints:
    return np.concatenate(parts).astype(np.int64)
