"""Dents on wavy skin: under noise, narrow, and as long as waves may be."""

import numpy as np
import pytest
from small_clouds import COLUMNS, ROWS, cloud_of, panel, raised

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.inspection import inspect

X, Y = 1.4e-3 * (np.mgrid[:COLUMNS, :ROWS].T - np.array([100, 75])).transpose(2, 0, 1)
WAVES = 6e-5 * np.sin(2 * np.pi * X / 0.12 + 1) * np.sin(2 * np.pi * Y / 0.16)
SMALLEST = SmallestDent(smallest_depth=5e-5)


def gaussian(x, y, length, width, depth):
    """A dent whose axes are those at 10 % of its depth."""
    square = (2 * (X - x) / length) ** 2 + (2 * (Y - y) / width) ** 2
    return depth * 10.0**-square


@pytest.mark.parametrize('noise', [1.5e-5, 3e-5])
@pytest.mark.parametrize('seed', [0, 1])
def test_narrow_dents_on_waves_are_found_where_noise_hides_the_waves_from_each_point(noise, seed):
    dents = gaussian(-0.06, -0.04, 0.02, 0.016, 4e-4) + gaussian(0.05, 0.03, 0.018, 0.018, 4e-4)
    found = inspect(raised(cloud_of(panel(), noise=noise, seed=seed), WAVES + dents), SMALLEST)
    assert len(found.waviness) == 1
    assert len(found.dents) == 2
    for dent in found.dents:
        assert abs(dent.depth.value - 4e-4) < 3 * dent.depth.uncertainty


def test_noise_alone_is_no_waviness():
    for seed in range(3):
        assert not inspect(cloud_of(panel(), noise=3e-5, seed=seed), SMALLEST).waviness


@pytest.mark.parametrize('depth', [3e-4, 6e-4])
def test_a_long_dent_on_waves_that_a_relief_explains_is_a_dent(depth):
    dent = gaussian(0.0, 0.01, 0.072, 0.045, depth)
    found = inspect(raised(cloud_of(panel(), noise=2e-6), 2 * WAVES + dent), SMALLEST)
    (long,) = found.dents
    assert abs(long.depth.value - depth) < 3 * long.depth.uncertainty
