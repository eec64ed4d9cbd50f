import numpy as np
import pytest

from ftp_dent_ros.inspection.measuring.outlines.dent_model import fit_dent
from ftp_dent_ros.simulation import Dent

X, Y = np.meshgrid(np.linspace(-0.06, 0.06, 61), np.linspace(-0.06, 0.06, 61))
KNOWN = np.ones(X.shape, bool)


def height(dent):
    values, _, _ = dent.height(X.ravel(), Y.ravel())
    return values.reshape(X.shape)


def test_the_dent_function_is_found():
    dent = Dent(0.004, -0.003, 0.06, 0.04, 0.002, 0.5)
    start = [0.0, 0.0, np.log(0.025), np.log(0.022), 0.2, 0.0015]

    model = fit_dent(X, Y, height(dent), KNOWN, np.array(start), 1.0)

    assert model.is_determined
    assert model.axes == pytest.approx((dent.length, dent.width), rel=1e-3)
    assert model.parameters[5] == pytest.approx(dent.depth, rel=1e-3)


def test_uncertainties_grow_with_the_noise():
    dent = Dent(0.0, 0.0, 0.06, 0.04, 0.002)
    start = np.array([0.0, 0.0, np.log(0.03), np.log(0.02), 0.0, 0.002])
    white = np.random.default_rng(0).normal(size=KNOWN.shape)
    small, large = (
        fit_dent(X, Y, height(dent) + noise * white, KNOWN, start, 1.0) for noise in (1e-5, 1e-4)
    )
    ratio = large.axes_uncertainty[0] / small.axes_uncertainty[0]
    assert ratio == pytest.approx(10, rel=0.3)
    assert abs(small.axes[0] - dent.length) < 4 * small.axes_uncertainty[0]


def test_what_the_data_do_not_tell_is_very_uncertain():
    noise = 1e-5 * np.random.default_rng(0).normal(size=KNOWN.shape)
    off_the_grid = np.array([0.5, 0.5, np.log(0.03), np.log(0.02), 0.0, 0.001])

    model = fit_dent(X, Y, noise, KNOWN, off_the_grid, 1.0)

    assert not model.is_determined
    assert np.isfinite(model.axes_uncertainty).all()
    assert model.axes_uncertainty[0] > 1.0
    assert 0.5 < model.angle_uncertainty < 1.0
