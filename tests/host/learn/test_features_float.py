"""The float64 features: what is planted comes out, and the thesis' two maps behave as it says."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.errors import NoSuchFile, UsageError
from palpate.features import map_features as features
from palpate.report.measured import real_map, real_strain_force

X = features.map_grid_mm()


def stroke(amp: float = 0.5, stdev: float = 4.0, step: float = 2.0) -> SimpleNamespace:
    """A made-up half stroke: every sensor traces a Gaussian, the face is curved, the probe rises by .2 mm."""
    positions = np.arange(-28.0, 0.1, step)
    sensors = np.arange(-11.25, 11.3, 1.5)
    skin = positions[:, None] + sensors
    images = 4.0 - 0.01 * sensors**2 + amp * np.exp(-(skin**2) / (2 * stdev**2))
    return SimpleNamespace(
        positions_mm=positions,
        sensors_mm=sensors,
        images_kPa=images,
        displacement_mm=2.5 - 0.2 * np.exp(-(positions**2) / 72),
    )


@settings(max_examples=25, deadline=None)
@given(st.floats(0.5, 8.0), st.floats(0.02, 3.0), st.floats(1.8, 12.0), st.floats(-6.0, 6.0))
def test_a_gaussian_on_a_base_is_found_again(base, amp, stdev, centre):
    fit = features.fit_gaussian(X, base + amp * np.exp(-((X - centre) ** 2) / (2 * stdev**2)))
    assert [fit.base_kPa, fit.amp_kPa, fit.centre_mm, fit.stdev_mm] == pytest.approx(
        [base, amp, centre, stdev], rel=1e-3, abs=1e-3
    )
    assert fit.rms_kPa < 1e-4 * max(1.0, amp)
    held = features.fit_gaussian(X, fit.curve(X), centre_mm=centre)
    assert held.centre_mm == centre and held.stdev_mm == pytest.approx(stdev, rel=1e-3)


@pytest.mark.parametrize("skew", [-0.4, 0.0, 0.4])
def test_the_skewness_of_a_lopsided_lump_is_found_with_its_sign(skew):
    z = (X - 1) / 4
    bump = np.exp(-z * z / 2) * (1 + skew / 6 * (z**3 - 3 * z))
    assert features.fit_gaussian(X, 4 + 0.5 * bump).skewness == pytest.approx(skew, abs=0.02)


def test_a_map_with_a_hole_or_too_few_points_is_refused():
    with pytest.raises(ValueError, match="not finite"):
        features.fit_gaussian(X, np.where(X == 0, np.nan, 4.0))
    with pytest.raises(ValueError, match="five"):
        features.fit_gaussian([0, 1, 2], [4, 5, 4])
    with pytest.raises(ValueError, match="divide"):
        features.map_grid_mm(3.0)


def test_method_1_is_lumpy_at_1_mm_and_method_2_is_not():
    """Thesis, Figure 9."""
    made = stroke()

    def roughness(method: int) -> float:
        _, p = features.tactile_map(made, method)
        return float(np.abs(np.diff(p, 2)).mean())

    assert roughness(1) > 5 * roughness(2)
    coarse = features.tactile_map(made, 2, features.map_grid_mm(2.0))[1]
    assert features.tactile_map(made, 2)[1][::2] == pytest.approx(coarse)
    with pytest.raises(ValueError, match="Method 3"):
        features.tactile_map(made, 3)


def test_a_half_stroke_is_continued_by_its_mirror_image():
    made = stroke()
    x, images, displacement = features.whole_stroke(made)
    assert x.tolist() == (-x[::-1]).tolist()
    assert images == pytest.approx(images[::-1, ::-1])
    assert displacement == pytest.approx(displacement[::-1])
    full = SimpleNamespace(
        positions_mm=x, images_kPa=images, displacement_mm=displacement, sensors_mm=made.sensors_mm
    )
    assert features.stroke_features(full) == features.stroke_features(made)


def test_features_of_a_stroke_mean_what_the_thesis_says():
    found = features.stroke_features(stroke(amp=0.5, stdev=4.0))
    assert found.stdev_mm == pytest.approx(4.0, rel=0.02)
    assert found.amp_kPa == pytest.approx(0.5, rel=0.02)
    # sensors stand at 6.75 and 8.25 mm: the image between them is read off a straight line
    assert found.curvature == pytest.approx(4.0 / (4.0 - 0.01 * 64), rel=0.002)
    assert (found.D28_mm, found.D0_mm) == pytest.approx((2.5, 2.3), abs=1e-4)
    assert found.strain(12.5)[1] == pytest.approx(2.3 / 12.5)
    assert set(found.relative_to(found).values()) == {1.0}


def test_the_peak_jumps_to_a_stiff_lump_as_the_probe_nears_it():
    soft, stiff = stroke(amp=0.02), stroke(amp=3.0, stdev=2.5)
    assert features.peak_jumps(soft) == []
    jumps = features.peak_jumps(stiff)
    assert jumps and all(beyond > 0 for _, beyond in jumps)
    place, pressure = features.peak_trace(stiff)
    assert place[-1] == pytest.approx(0.0, abs=0.1)
    assert pressure[-1] == pytest.approx(7.0, rel=0.02)


def test_a_real_map_and_a_real_force_curve_are_read_from_tables(tmp_path):
    path = tmp_path / "map.csv"
    rows = "\n".join(f"{x},{4 + 0.5 * np.exp(-(x**2) / 32)}" for x in X)
    path.write_text("x_mm,pressure_kPa\n" + rows)
    measured = real_map(path)
    assert measured.fit.stdev_mm == pytest.approx(4.0, rel=1e-3) and measured.r2 > 0.999
    path.write_text(rows)
    assert real_map(path).fit == measured.fit, "a table without a header is read the same"

    curve = tmp_path / "curve.csv"
    curve.write_text("force,displacement\n" + "\n".join(f"{13 * (d / 20) ** 1.6},{d}" for d in (1, 2, 3, 4)))
    fitted = real_strain_force(curve, 20.0)
    assert pytest.approx((13, 1.6)) == (fitted.A, fitted.B)

    with pytest.raises(NoSuchFile, match="no file"):
        real_map(tmp_path / "absent.csv")
    path.write_text("x,p\n1,two\n3,4")
    with pytest.raises(UsageError, match="not a table of numbers"):
        real_map(path)
    with pytest.raises(UsageError, match="thickness"):
        real_strain_force(curve, 0.0)
