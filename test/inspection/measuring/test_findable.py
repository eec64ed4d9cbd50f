"""From which depth on a dent is told to have been findable, and whether it is found then."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_clouds import COLUMNS, PIXEL, ROWS, cloud_of, panel, raised

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.inspection import inspect

SETTINGS = SmallestDent()
WIDTH = SETTINGS.smallest_width
SPACING = 0.7 * PIXEL
X, Y = SPACING * (np.mgrid[:COLUMNS, :ROWS].T - np.array([100, 75])).transpose(2, 0, 1)
# Wavelength of which half is left by four fits, in standard deviations of their Gaussians.
HALVED = 3.277


def seen(depth, resolution, noise=8e-6):
    """A cloud of a resolution with a dent that is narrow, but by no chance too narrow."""
    rest = dent = depth * 10 ** -((X**2 + Y**2) / (1.2 * WIDTH / 2) ** 2)
    for _ in range(4):
        rest = rest - cv2.GaussianBlur(rest, (0, 0), resolution / HALVED / SPACING)
    shape = (ROWS, COLUMNS)
    told = {
        'sigma': np.full(shape, noise, np.float32),
        'resolution': np.full(shape, resolution, np.float32),
    }
    return replace(raised(cloud_of(panel(tilt=(0, 0)), noise=noise), dent - rest), **told)


def promised(resolution, noise=8e-6):
    """Of bare skin, as it would have been told."""
    return float(np.nanmedian(inspect(seen(0.0, resolution, noise)).findable))


@pytest.mark.parametrize(
    ('resolution', 'noise'),
    [
        (0.004, 2e-6),
        (0.004, 8e-6),
        (0.007, 2e-6),
        (0.007, 2e-5),
        (0.009, 8e-6),
        (0.009, 2e-5),
    ],
)
def test_a_narrow_dent_is_listed_from_the_depth_that_is_told(resolution, noise):
    depth = promised(resolution, noise)
    (dent,) = inspect(seen(1.1 * depth, resolution, noise)).dents
    assert np.hypot(*dent.position[:2]) < 2e-3
    # Nor is twice as much told as is too little.
    assert inspect(seen(0.5 * depth, resolution, noise)).dents == ()


def test_what_windows_take_of_a_narrow_dent_is_asked_for_where_they_take_it():
    coarse, fine = seen(0.0, 0.009), seen(0.0, 0.004)
    resolution = np.where(X < 0, coarse.resolution, fine.resolution)
    findable = inspect(replace(fine, resolution=resolution)).findable
    left, right = np.nanmedian(findable[:, :80]), np.nanmedian(findable[:, 120:])
    assert right < 1.3 * SETTINGS.smallest_depth
    assert left > 1.1 * right


SEEN = pytest.mark.xfail(strict=True, reason='it is listed as a dent')


@pytest.mark.parametrize('part', [pytest.param(each, marks=SEEN) for each in (1.4, 1.6)])
def test_where_no_depth_of_a_narrow_dent_would_do_none_is_told(part):
    resolution = part * WIDTH
    # As deep as 0.3 of its width a dent is no dented skin any more.
    assert promised(resolution) == pytest.approx(0.3 * WIDTH)
    found = inspect(seen(0.1 * WIDTH, resolution))
    assert found.dents == ()
    assert [other.kind for other in found.others] == ['other']
