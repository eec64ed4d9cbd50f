import numpy as np

from ftp_dent_ros.pose import Pose


def test_rpy_follows_rep_103():
    """Roll, pitch, yaw about fixed axes: yaw turns x to y, pitch x to -z, roll y to z."""
    x, y = np.eye(3)[:2]
    turn = np.pi / 2
    np.testing.assert_allclose(Pose.from_rpy((0, 0, turn), (0, 0, 0)).apply(x), y, atol=1e-15)
    np.testing.assert_allclose(
        Pose.from_rpy((0, turn, 0), (0, 0, 0)).apply(x), (0, 0, -1), atol=1e-15
    )
    np.testing.assert_allclose(
        Pose.from_rpy((turn, 0, 0), (0, 0, 0)).apply(y), (0, 0, 1), atol=1e-15
    )


def test_camera_optical_axes_on_a_forward_looking_mount():
    """REP 103: an optical frame's z looks along the body's x, its x to the right, its y down."""
    optical = Pose.from_rpy((-np.pi / 2, 0, -np.pi / 2), (0, 0, 0))
    np.testing.assert_allclose(
        optical.apply(np.eye(3)), [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-15
    )


def test_apply_keeps_single_precision_and_the_shape():
    cloud = np.ones((2, 3, 3), np.float32)
    moved = Pose.from_rpy((0, 0, 0), (0.5, 0, 0)).apply(cloud)
    assert moved.dtype == np.float32
    assert moved.shape == cloud.shape
