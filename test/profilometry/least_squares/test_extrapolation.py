import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows

WINDOWS = Windows(0.9, 0.8)
SHAPE = 90, 120


@pytest.fixture
def plane():
    row, column = np.indices(SHAPE)
    return (2 + 0.03 * column - 0.02 * row).astype(np.float32)


@pytest.fixture
def known():
    inside = np.zeros(SHAPE, bool)
    inside[20:70, 30:90] = True
    return inside


def test_a_plane_goes_on_by_its_slope(plane, known):
    beyond = Extrapolation(known, WINDOWS).by_slope(np.where(known, plane, 99).astype(np.float32))
    near = np.zeros(SHAPE, bool)
    near[16:74, 34:86] = near[24:66, 26:94] = True  # not beyond the corners
    np.testing.assert_allclose(beyond[near], plane[near], atol=0.05)
    np.testing.assert_array_equal(beyond[known], plane[known])
    assert (beyond[:, 118:] == 0).all()


def test_a_level_goes_on_by_the_mean(known):
    field = np.where(known, 7.0, 1e6).astype(np.float32)
    beyond = Extrapolation(known, WINDOWS).by_mean(field)
    np.testing.assert_allclose(beyond[17:73, 27:93], 7, rtol=1e-3)


def test_what_is_known_everywhere_is_left(plane):
    extrapolation = Extrapolation(np.ones(SHAPE, bool), WINDOWS)
    assert extrapolation.by_slope(plane) is plane
    assert extrapolation.by_mean(plane) is plane


def test_of_nothing_comes_nothing(plane):
    nothing = Extrapolation(np.zeros(SHAPE, bool), WINDOWS)
    assert (nothing.by_slope(plane) == 0).all()
    assert (nothing.by_mean(plane) == 0).all()
