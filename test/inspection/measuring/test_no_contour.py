"""Skin that no contour meets: popped in over all of the view, or of no common shape."""

import numpy as np
import pytest
from small_clouds import COLUMNS, ROWS, cloud_of, panel, raised

from ftp_dent_ros.inspection.measuring.inspection import inspect

X, Y = 1.4e-3 * (np.mgrid[:COLUMNS, :ROWS].T - np.array([100, 75])).transpose(2, 0, 1)


def gaussian(x, y, length, width, depth):
    """A dent whose axes are those at 10 % of its depth."""
    square = (2 * (X - x) / length) ** 2 + (2 * (Y - y) / width) ** 2
    return depth * 10.0**-square


@pytest.mark.parametrize(('depth', 'width'), [(1e-3, 0.3), (1e-3, 0.4), (4e-3, 0.3), (4e-3, 0.4)])
def test_dents_in_a_panel_that_has_popped_in_are_found_and_nothing_else_is_a_dent(depth, width):
    popped = gaussian(0.01, 0.0, 1.3 * width, width, depth)
    dents = gaussian(-0.06, -0.03, 0.03, 0.03, 6e-4) + gaussian(0.06, 0.03, 0.03, 0.02, 4e-4)
    found = inspect(raised(cloud_of(panel(), noise=3e-6), popped + dents))
    assert len(found.dents) == 2
    assert all(each.kind == 'other' and each.is_cut for each in found.others)
    for dent, true in zip(found.dents, (6e-4, 4e-4), strict=True):
        assert abs(dent.depth.value - true) < 3 * dent.depth.uncertainty
        assert dent.depth.uncertainty < true / 4
