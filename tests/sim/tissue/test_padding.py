"""A padding on the face gives way as a bed of springs, and an array's own rows are read."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.sim.tissue import Case, CaseError, Settings
from palpate.sim.tissue.contact import Contact
from palpate.sim.tissue.derivatives import differentiate
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.geometry import geometry_of
from palpate.sim.tissue.newton import Newton
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.reading import OWN_PLACES, places_read, read_sensors
from palpate.sim.tissue.solver.choice import make_solver
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import Topology
from tests.sim.tissue.blocks import block, tissue_of
from tests.sim.tissue.test_derivatives import FINE, worst_difference

CASE = Case(10.0, 0.8, 10.0, 0.6, padding_mm_per_kPa=0.05)


def test_on_rigid_tissue_a_padding_alone_gives_way():
    """A parabola pressed into springs: p = (delta - s^2 / 2R) / c, and its force."""
    mesh, c, radius, force = block(np.arange(-20, 20.5, 0.5), [0, 4, 8]), 0.05, 40.0, 150.0
    tissue = tissue_of(mesh, young_kPa=1e6)
    contact = Contact(mesh, ProbeShape(radius, 30.0, 0.1), 0.0, padding_mm_per_kPa=c)
    newton = Newton(tissue, contact, make_solver("strip", mesh), 1e-7)
    nothing = np.zeros(2 * len(mesh.nodes_mm))
    start = State(nothing, 7.9, np.zeros(len(mesh.surface)), np.zeros((len(mesh.elements), 3)))
    state = newton.solve(start, 0.0, force, limit=40)
    x, pressure, _ = contact.pressure(state.u, state.multiplier, 0.0)
    delta = (force * c * 3 / (4 * np.sqrt(2 * radius))) ** (2 / 3)
    assert 8.0 - state.height == pytest.approx(delta, rel=0.005)
    assert np.abs(pressure - np.maximum(delta - x**2 / (2 * radius), 0) / c).max() < 0.02 * delta / c


def test_derivatives_of_a_padded_face_are_those_of_whole_strokes():
    fields = ("padding_mm_per_kPa", "d_mm", "h", "gland_ratio", "probe_radius_mm")
    assert max(worst_difference(CASE, FINE, fields, 3).values()) < 1e-3


def test_an_arrays_own_rows_are_read_and_differentiated():
    """16 rows at 3 mm feel as much of a line as twice as many at half their pitch, two by two."""
    coarse, fine = places_read(16, 3.0), places_read(32, 1.5)
    s = np.linspace(-40, 40, 400)
    pressure = np.exp(-((s / 7) ** 2))
    both = read_sensors(s, pressure, fine).reshape(16, 2).mean(1)
    assert np.abs(read_sensors(s, pressure, coarse) - both).max() < 0.002
    assert np.array_equal(read_sensors(s, pressure), read_sensors(s, pressure, OWN_PLACES))
    topology = Topology(CASE, FINE, -1.0, 1.0)
    ends = [
        solve_frames(CASE, FINE, topology.geometry(CASE), np.zeros(1), np.array([F]), sensors=coarse)
        for F in (40.0, 40.001)
    ]
    slope = differentiate(ends[0], topology, ()).images[0, :, -1]
    assert slope == pytest.approx((ends[1].images_kPa - ends[0].images_kPa)[0] / 0.001, abs=1e-4)


def test_a_padding_is_for_cylinders_and_the_compiled_solver():
    assert Case.from_code(CASE.code) == CASE and "p0.05" in CASE.code
    assert "padding_mm_per_kPa" not in replace(CASE, padding_mm_per_kPa=0.0).to_dict()
    with pytest.raises(CaseError, match="padding is for cylinders only"):
        replace(CASE, shape="ball")
    settings = Settings(solver="reference")
    with pytest.raises(CaseError, match="bare faces only"):
        solve_frames(CASE, settings, geometry_of(CASE, settings, -1, 1), np.zeros(1), np.array([40.0]))
