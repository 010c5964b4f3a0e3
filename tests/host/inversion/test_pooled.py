"""Over a solid lump the fit and the regression's estimate are weighed together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.inversion.pooled import pooled
from palpate.inversion.search import Mode
from palpate.inversion.solid_classes import BALL, ELLIPSOID
from palpate.inversion.start import Start

SD = (0.1, 0.15, 0.1, 0.1, 0.05)


@pytest.fixture(params=[BALL, ELLIPSOID], ids=lambda of: of.name)
def fit(request):
    """A mode over a lump of 12 mm, 6 mm deep, in fat of 10 kPa, every number known to 10 %."""
    of = request.param
    z = np.append(of.column("mean"), np.log(10.0))
    z[:3] = np.log(12.0), np.log(6.0), 0.3
    mode = Mode(z, 0.01 * np.eye(len(z)), None, 1.0, True, 1, 0.0, None, None, None)
    return SimpleNamespace(of=of, at={"ln_E": slice(len(z) - 1, len(z))}), mode


def estimate(**said):
    """A regression's, the fit's own where nothing else is said."""
    own = {"d_mm": 12.0, "depth_mm": 6.0, "t_mm": 12.0, "E_inv23": 0.3, "E_kPa": 10.0, "sd": SD}
    return Start(0, lump_mm=0.0, **(own | said))


def test_where_there_is_no_estimate_the_fit_stays_but_for_its_spread(fit):
    posterior, mode = fit
    mode = replace(mode, covariance=mode.covariance / 4)
    said = pooled(posterior, mode, estimate(d_mm=20.0, sd=()))
    assert np.array_equal(said.z, mode.z)
    wider = np.diag(said.covariance) / np.diag(mode.covariance)
    assert (wider >= 1.0).all() and (wider[:3] > 1.1).all() and wider[-1] > 1.1


def test_two_that_agree_know_more_than_either(fit):
    said = pooled(*fit, estimate())
    assert np.allclose(said.z, fit[1].z, atol=1e-3)
    sd = np.sqrt(np.diag(said.covariance))
    # off the lumps that it was fitted to, an estimate is out by 1.4 times what it says
    assert sd[0] < SD[0] and sd[2] < SD[3] and sd[-1] < 1.4 * SD[4]
    assert np.linalg.eigvalsh(said.covariance).min() > 0


def test_the_answer_lies_between_the_two(fit):
    said = pooled(*fit, estimate(d_mm=13.0, E_kPa=10.5))
    assert np.log(12.0) < said.z[0] < np.log(13.0)
    assert np.log(10.0) < said.z[-1] < np.log(10.5)


def test_two_that_contradict_each_other_know_less_and_are_less_likely(fit):
    near, far = (pooled(*fit, estimate(d_mm=d, E_kPa=E)) for d, E in ((12.5, 10.2), (30.0, 20.0)))
    assert np.all(np.diag(far.covariance) > 2 * np.diag(near.covariance))
    assert far.log_evidence < near.log_evidence


def test_a_surer_estimate_weighs_more(fit):
    sure, unsure = (
        pooled(*fit, estimate(d_mm=14.0, depth_mm=7.0, t_mm=14.0, sd=tuple(by * np.array(SD))))
        for by in (0.5, 2)
    )
    assert np.log(12.0) < unsure.z[0] < sure.z[0] < np.log(14.0)
