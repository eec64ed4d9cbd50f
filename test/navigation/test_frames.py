"""Hand-checked vectors for every conversion between MAVLink's frames and ROS's."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation import frames

HALF = np.sqrt(0.5)
FORWARD, LEFT, UP = np.eye(3)
EAST, NORTH, SKY = np.eye(3)

# MAVLink's w, x, y, z of the attitude; where the nose, the left wing and the roof point (ENU).
ATTITUDES = {
    'nose north, level': ([1, 0, 0, 0], NORTH, -EAST, SKY),
    'nose east (yaw +90, clockwise)': ([HALF, 0, 0, HALF], EAST, NORTH, SKY),
    'nose straight up (pitch +90)': ([HALF, 0, HALF, 0], SKY, -EAST, -NORTH),
    'nose north, roll right 90': ([HALF, HALF, 0, 0], NORTH, SKY, EAST),
    'nose east, roll right 90': ([0.5, 0.5, 0.5, 0.5], EAST, SKY, -NORTH),
}


@pytest.mark.parametrize('case', ATTITUDES)
def test_attitude_points_nose_wing_and_roof_where_they_point(case: str) -> None:
    quaternion, nose, left_wing, roof = ATTITUDES[case]
    attitude = Rotation.from_quat(frames.enu_attitude(quaternion))
    assert_allclose(attitude.apply(FORWARD), nose, atol=1e-12)
    assert_allclose(attitude.apply(LEFT), left_wing, atol=1e-12)
    assert_allclose(attitude.apply(UP), roof, atol=1e-12)


def test_vectors_of_world_and_body() -> None:
    assert_allclose(frames.enu_from_ned([1, 2, 3]), [2, 1, -3])
    assert_allclose(frames.flu_from_frd([1, 2, 3]), [1, -2, -3])
