"""What the covariance of a tag is made of, part by part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.pose_covariance import Motion
from ftp_dent_ros.pose import Pose

STILL = Motion(np.zeros(3), np.zeros(3), 0.0, True)
GOOD = pose_covariance.diagonal((0.03, 0.03, 0.03), (0.01, 0.01, 0.02))


def deviations(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(covariance))


def ekf(horizontal: float, vertical: float, compass: float):
    return mavlink.MAVLink_ekf_status_report_message(0, 0, horizontal, vertical, compass, 0)


def px4(horizontal: float, vertical: float, compass: float):
    return mavlink.MAVLink_estimator_status_message(
        0, 0, 0, 0, 0, compass, 0, 0, horizontal, vertical
    )


def test_ardupilots_ratios_are_innovations_by_its_gates() -> None:
    best = deviations(pose_covariance.reported(ekf(0, 0, 0)))
    assert_allclose(best, [0.03, 0.03, 0.05, *np.radians([0.5, 0.5, 1.0])])
    # At the gate, beyond which the estimator throws a measurement away.
    worst = deviations(pose_covariance.reported(ekf(1, 1, 1)))
    assert_allclose(worst[:3], [2.5, 2.5, 10], rtol=1e-3)
    assert np.degrees(worst[5]) == pytest.approx(40, abs=1)


@pytest.mark.parametrize('wrong', [np.nan, np.inf, -1.0])
@pytest.mark.parametrize('report', [ekf, px4])
def test_an_impossible_report_says_nothing(report, wrong: float) -> None:
    for values in ((wrong, 0, 0), (0, wrong, 0), (0, 0, wrong)):
        if (report, values[2]) != (px4, np.nan):
            assert pose_covariance.reported(report(*values)) is None


def test_what_is_mounted_on_a_vehicle_moves_with_it() -> None:
    rng = np.random.default_rng(8)
    pose = Pose(Rotation.random(random_state=1), np.array([4.0, 5.0, 6.0]))
    mount = Pose(Rotation.random(random_state=2), np.array([0.5, -0.2, 0.3]))
    root, mount_root = 1e-3 * rng.normal(size=(2, 6, 6))
    told = pose_covariance.of_mounted(root @ root.T, pose, mount, mount_root @ mount_root.T)
    # Many poses drawn as the covariances say, each composed.
    true = pose @ mount
    off, on_it = (each @ rng.normal(size=(6, 4000)) for each in (root, mount_root))
    turn = Rotation.from_rotvec(off[3:].T) * pose.rotation
    places = pose.translation + off[:3].T + turn.apply(mount.translation + on_it[:3].T)
    turned = turn * Rotation.from_rotvec(on_it[3:].T) * mount.rotation * true.rotation.inv()
    errors = np.hstack([places - true.translation, turned.as_rotvec()])
    assert_allclose(np.cov(errors.T), told, atol=0.06 * np.abs(told).max())


def test_a_doubtful_clock_is_doubt_along_the_way() -> None:
    east = Motion(np.array([2.0, 0, 0]), np.array([0, 0, 1.0]), 0.0, True)
    covariance = pose_covariance.of_tag(GOOD, east, 0.03) - GOOD
    sigma = 0.03 / np.sqrt(3)
    expected = np.zeros((6, 6))
    expected[0, 0], expected[5, 5], expected[0, 5] = (2 * sigma) ** 2, sigma**2, 2 * sigma**2
    expected[5, 0] = expected[0, 5]
    assert_allclose(covariance, expected, atol=1e-15)
    assert_allclose(pose_covariance.of_tag(GOOD, STILL, 0.03), GOOD)
    gap = replace(STILL, gap=0.1)
    added = deviations(pose_covariance.of_tag(GOOD, gap, 0.0) - GOOD)
    assert_allclose(added, 3 * 0.1**2 / 8)


def test_an_odometrys_covariance_is_turned_into_the_map() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6))
    ned = root @ root.T
    found = pose_covariance.of_odometry(ned[np.triu_indices(6)])
    # East, north, up out of north, east, down: of the position and of the rotation.
    turn = np.zeros((6, 6))
    turn[[0, 1, 2, 3, 4, 5], [1, 0, 2, 4, 3, 5]] = [1, 1, -1, 1, 1, -1]
    assert_allclose(found, turn @ ned @ turn.T, atol=1e-12)


def test_px4_says_only_the_diagonal() -> None:
    upper = np.full(21, np.nan)
    upper[[0, 6, 11, 15, 18, 20]] = [1, 2, 3, 4, 5, 6]
    assert_allclose(pose_covariance.of_odometry(upper), np.diag([2.0, 1, 3, 5, 4, 6]))
    for missing in (0, 11, 20):
        partial = upper.copy()
        partial[missing] = np.nan
        assert pose_covariance.of_odometry(partial) is None
    assert pose_covariance.of_odometry(np.zeros(21)) is None
    # Correlations that cannot be are left out.
    upper = np.zeros(21)
    upper[[0, 6, 11, 15, 18, 20]], upper[1] = 1.0, 5.0
    assert_allclose(pose_covariance.of_odometry(upper), np.eye(6))
