import numpy as np
import pytest

from ftp_dent_ros.inspection.blurring import Grid
from ftp_dent_ros.inspection.model import fit_dents
from ftp_dent_ros.simulation import Dent

GRID = Grid(np.linspace(-0.06, 0.06, 61), np.linspace(-0.06, 0.06, 61))
KNOWN = np.ones((61, 61), bool)


def height(dent):
    values, _, _ = dent.height(GRID.x.ravel(), GRID.y.ravel())
    return values.reshape(GRID.x.shape)


@pytest.mark.parametrize('blur', [0.0, 0.003])
def test_the_dent_function_and_the_blur_over_it_are_found(blur):
    dent = Dent(0.004, -0.003, 0.06, 0.04, 0.002, 0.5)
    start = [[0.0, 0.0, np.log(0.025), np.log(0.022), 0.2, 0.0015]]

    fitted = fit_dents(GRID, GRID.blurred(height(dent), blur**2), KNOWN, np.array(start), 1.0)

    (model,) = fitted.dents
    assert model.axes == pytest.approx((dent.length, dent.width), rel=2e-3)
    assert model.parameters[5] == pytest.approx(dent.depth, rel=2e-3)
    assert fitted.blur == pytest.approx(blur, abs=2e-4)


def test_two_dents_are_told_apart():
    one, other = Dent(-0.015, 0, 0.04, 0.04, 0.001), Dent(0.015, 0.005, 0.04, 0.03, 0.002)
    half = np.log(0.017)
    starts = [[-0.012, 0, half, half, 0, 0.001], [0.013, 0, half, half, 0, 0.001]]

    fitted = fit_dents(GRID, height(one) + height(other), KNOWN, np.array(starts), 1.0)

    depths = [model.parameters[5] for model in fitted.dents]
    assert depths == pytest.approx([0.001, 0.002], rel=1e-2)


def test_uncertainties_grow_with_the_noise():
    dent = Dent(0.0, 0.0, 0.06, 0.04, 0.002)
    start = np.array([[0.0, 0.0, np.log(0.03), np.log(0.02), 0.0, 0.002]])
    white = np.random.default_rng(0).normal(size=KNOWN.shape)
    small, large = (
        fit_dents(GRID, height(dent) + noise * white, KNOWN, start, 1.0).dents[0]
        for noise in (1e-5, 1e-4)
    )
    ratio = large.axes_uncertainty[0] / small.axes_uncertainty[0]
    assert ratio == pytest.approx(10, rel=0.3)
    assert abs(small.axes[0] - dent.length) < 4 * small.axes_uncertainty[0]


def test_what_the_data_do_not_tell_is_very_uncertain():
    dent = Dent(0.0, 0.0, 0.06, 0.04, 0.002)
    same = [0.001, 0.0, np.log(0.03), np.log(0.02), 0.0, 0.001]
    noise = 1e-5 * np.random.default_rng(0).normal(size=KNOWN.shape)
    for start in ([same, same], [same, [0.5, 0.5, *same[2:]]]):
        fitted = fit_dents(GRID, height(dent) + noise, KNOWN, np.array(start), 1.0)
        second = fitted.dents[1]
        assert np.isfinite(second.axes_uncertainty).all()
        assert second.axes_uncertainty[0] > 1.0
        assert 0.5 < second.angle_uncertainty < 1.0
