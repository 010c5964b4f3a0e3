"""The stroke in felupe: Q1 elements with constant pressure, nodal penalty contact. Units: mm, kPa, N/m."""

from __future__ import annotations

import time

import felupe
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.contact import read_sensors
from palpate.sim.tissue.material import elasticity
from palpate.sim.tissue.mesh import TissueMesh, build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape
from tests.benchmarks.peers import QUARTERS, Peer

PENALTY = 3e3
_TOLERANCE = 1e-4  # of the force, at any node
_LONGEST_MM = 0.5


class PenaltyContact:
    """An item for felupe: surface nodes against the probe, whose height is the last point's second value."""

    def __init__(self, field, mesh: TissueMesh, shape: ProbeShape) -> None:
        self.field, self.shape = field, shape
        self.nodes = mesh.surface
        x = mesh.nodes_mm[self.nodes, 0]
        self.weight = np.gradient(x)
        self.weight[[0, -1]] /= 2
        self.X = mesh.nodes_mm[self.nodes]
        self.height = 2 * len(mesh.nodes_mm) + 1
        self.size = self.height + 1
        self.position, self.force = 0.0, 0.0
        self.active = np.zeros(len(x), bool)
        self.results = felupe.mechanics._helpers.Results()
        self.assemble = felupe.mechanics._helpers.Assemble(vector=self._vector, matrix=self._matrix)

    def state(self):
        u = self.field[0].values
        x = self.X + u[self.nodes]
        f, slope, curvature = self.shape.height(x[:, 0] - self.position)
        gap = x[:, 1] - (self.X[0, 1] + u[-1, 1]) - f
        return gap * PENALTY * self.weight * self.active, gap, slope, curvature

    def choose(self, gap_before=None, slope=None, step=None):
        """Active set: nodes that touch stay while the last linear step leaves them under pressure."""
        gap = self.state()[1]
        if step is None:
            self.active = self.active | (gap > 0)
            return
        move = step[self.nodes]
        linear = gap_before - slope * move[:, 0] + move[:, 1] - step[-1, 1]
        self.active = np.where(self.active, linear > 0, gap > 0)

    def _vector(self, field=None, **_):
        pull, _, slope, _ = self.state()
        r = np.zeros(self.size)
        np.add.at(r, 2 * self.nodes, -pull * slope)
        np.add.at(r, 2 * self.nodes + 1, pull)
        r[self.height] = self.force - pull.sum()
        self.results.force = coo_matrix(r[:, None]).tocsr()
        return self.results.force

    def _matrix(self, field=None, **_):
        pull, _, slope, curvature = self.state()
        k = PENALTY * self.weight * self.active
        pull = np.maximum(pull, 0.0)
        x, y, h = 2 * self.nodes, 2 * self.nodes + 1, np.full(len(self.nodes), self.height)
        entries = [
            (x, x, k * slope**2 - pull * curvature), (x, y, -k * slope), (y, x, -k * slope), (y, y, k),
            (x, h, k * slope), (h, x, k * slope), (y, h, -k), (h, y, -k), (h, h, k),
        ]  # fmt: skip
        rows, columns, values = (np.concatenate(part) for part in zip(*entries))
        self.results.stiffness = coo_matrix((values, (rows, columns)), (self.size, self.size)).tocsr()
        return self.results.stiffness


def run(case: Case, settings: Settings) -> Peer:
    """Simulate the stroke of `case` on our mesh, every nine-node element cut into four."""
    began = time.process_time()
    positions = settings.positions_mm()
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    constants = elasticity(case, mesh)
    cells = mesh.elements[:, QUARTERS].reshape(-1, 4)
    owner = np.repeat(np.arange(len(mesh.elements)), 4)
    points = np.vstack([mesh.nodes_mm, [[0.0, case.t_mm]]])
    whole = felupe.Mesh(points, cells, "quad")
    field = felupe.FieldContainer([felupe.FieldPlaneStrain(felupe.RegionQuad(whole), dim=2)])
    bodies = []
    for mu in np.unique(constants.mu):
        part = felupe.Mesh(points, cells[constants.mu[owner] == mu], "quad")
        region = felupe.RegionQuad(part)
        own = felupe.FieldPlaneStrain(region, dim=2, values=field[0].values)
        own.values = field[0].values  # all bodies move the same unknowns
        bulk = constants.bulk[constants.mu == mu][0] - mu / 3
        bodies.append(
            felupe.SolidBodyNearlyIncompressible(
                felupe.NeoHooke(mu=mu), felupe.FieldContainer([own]), bulk=bulk
            )
        )
    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    contact = PenaltyContact(field, mesh, shape)
    held = np.append(mesh.fixed.ravel(), [True, False])
    free = np.nonzero(~held)[0]
    contact.position, contact.force = float(positions[0]), case.F_N_per_m
    values = field[0].values
    _lower(field, bodies, contact, free[:-1])  # by height: a force alone would not start
    displacement, images = [], []
    track = _Track(field, bodies, contact, free)
    for position in positions:
        track.move(float(position))
        pull = contact.state()[0]
        x = contact.X[:, 0] + values[contact.nodes, 0]
        pressure = np.maximum(pull, 0.0) / np.gradient(x)
        displacement.append(-values[-1, 1])
        images.append(read_sensors(x - position, pressure))
    return Peer(
        "felupe Q1P0", len(points), time.process_time() - began, np.array(displacement), np.array(images)
    )


def _newton(field, bodies, contact, free, limit=12) -> None:
    values = field[0].values
    contact.choose()
    for _ in range(limit):
        r = contact.assemble.vector()
        for body in bodies:
            v = body.assemble.vector(body.field)
            v.resize(r.shape)
            r = r + v
        out = r.toarray().ravel()[free]
        if np.abs(out).max() < _TOLERANCE * contact.force:
            return
        K = contact.assemble.matrix()
        for body in bodies:
            m = body.assemble.matrix(body.field)
            m.resize(K.shape)
            K = K + m
        step = np.zeros(values.size)
        # The order for symmetric matrices: SuperLU's own choice takes four times as long.
        step[free] = splu(
            K[free][:, free].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
            diag_pivot_thresh=0.0,
        ).solve(-out)
        step = step.reshape(values.shape)
        _, gap, slope, _ = contact.state()
        values += step
        contact.choose(gap, slope, step)
        if not np.abs(step).max() < 5.0:
            break
    raise ArithmeticError("no convergence")


def _lower(field, bodies, contact, free, step=0.25) -> None:
    """Lower the probe until it nearly bears the force."""
    values = field[0].values
    while contact.state()[0].sum() < 0.95 * contact.force:
        depth = -values[-1, 1]

        def go(share, depth=depth) -> None:
            values[-1, 1] = -(depth + share * step)

        _advance(field, bodies, contact, free, go)


class _Track:
    """Slides the probe under its force, each move starting from a straight line through the last two states.

    Moves of more than half a millimetre diverge, whatever they start from (our own predictor and damped steps
    were tried too): felupe's pressures belong to the displacements, ours are unknowns of their own.
    """

    def __init__(self, field, bodies, contact, free) -> None:
        self.parts = field, bodies, contact, free
        self.values, self.contact = field[0].values, contact
        self.before: tuple[float, np.ndarray] | None = None
        self.reach = _LONGEST_MM

    def move(self, position: float) -> None:
        """Go to `position`; what fails is tried again half as far."""
        field, bodies, contact, free = self.parts
        if position == contact.position:
            _newton(field, bodies, contact, free)
        while contact.position < position:
            here, state = contact.position, self.values.copy()
            states, active = [body.checkpoint() for body in bodies], contact.active.copy()
            there = position if position - here < 1.05 * self.reach else here + self.reach
            try:
                if self.before is not None:
                    share = (there - here) / (here - self.before[0])
                    self.values += share * (state - self.before[1])
                contact.position = there
                _newton(field, bodies, contact, free)
                self.before = (here, state)
                self.reach = min(1.5 * self.reach, _LONGEST_MM)
            except (ArithmeticError, RuntimeError):
                if there - here < 1 / 32:
                    raise
                for body, old in zip(bodies, states):
                    body.restore(old)
                    body.field[0].values = self.values
                self.values[:], contact.active, contact.position = state, active, here
                self.reach = (there - here) / 2


def _advance(field, bodies, contact, free, go, low=0.0, high=1.0) -> None:
    """Go from `low` to `high` of a step, in halves where Newton's method fails."""
    states = [body.checkpoint() for body in bodies]
    before, active = field[0].values.copy(), contact.active.copy()
    try:
        go(high)
        _newton(field, bodies, contact, free)
    except (ArithmeticError, RuntimeError):
        if high - low < 1 / 64:
            raise
        for body, state in zip(bodies, states):
            body.restore(state)
            body.field[0].values = field[0].values
        field[0].values[:], contact.active = before, active
        _advance(field, bodies, contact, free, go, low, (low + high) / 2)
        _advance(field, bodies, contact, free, go, (low + high) / 2, high)
