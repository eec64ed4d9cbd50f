"""Values as people read them."""

import numpy as np
import pytest

from ftp_dent_ros.pages.words import position_interval


@pytest.mark.parametrize(
    ('metres', 'written'), [(0.0568, '± 110 mm'), (0.0031, '± 6.1 mm'), (0.00002, '± 0.039 mm')]
)
def test_a_place_is_known_within_millimetres_of_two_digits(metres, written):
    assert position_interval(metres**2 * np.eye(3)) == written
