"""The node as a process: clouds with skin and erring poses in, a path that fits the skin out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from flown_skin import COLUMNS, ROWS, SPACING, STATED, FlownSkin, erring
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    covariance_from_message,
    covariant_pose_message,
    image_to_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED, POSES

CAMERA = 'camera_optical_frame'
HALF_S = 500_000_000
WARN = DiagnosticStatus.WARN


class Bench:
    """A surveying process, what goes into it and what comes out."""

    def __init__(self, ros):
        self.ros = ros
        self.process = ros.start('survey')
        self.state = ros.diagnostics('survey')
        self.found = ros.collect(PoseWithCovarianceStamped, 'survey/pose', POSES)
        self.skins = ros.publisher(Image, 'skin', CLOUDS)
        self.points = ros.publisher(PointCloud2, 'points', CLOUDS)
        self.poses = ros.publisher(PoseWithCovarianceStamped, 'tagged/camera_pose', POSES)
        self.state.says('waiting for clouds')
        ros.met_by('survey')

    def show(self, number, cloud, skin, pose, covariance=STATED, frame_id='map'):
        """Send what there is of one stamp."""
        stamp_ns = (number + 1) * HALF_S
        self.skins.publish(image_to_message(skin, stamp_ns, CAMERA))
        self.points.publish(cloud_to_message(cloud, stamp_ns, CAMERA))
        self.poses.publish(covariant_pose_message(pose, covariance, stamp_ns, frame_id))


@pytest.fixture(scope='module')
def flight():
    skin = FlownSkin(31)
    poses = list(skin.flight(6))
    clouds = [skin.seen(pose, index) for index, pose in enumerate(poses)]
    return poses, erring(poses, 31), [(cloud, cloud.skin) for cloud in clouds]


def steps(poses):
    """From each pose to the next, metres, along the first."""
    return np.array([(a.inverse() @ b).translation for a, b in pairwise(poses)])


def _area(message):
    """Of the measured skin, square metres."""
    corners = [[each.x, each.y, each.z] for each in message.markers[1].points]
    a, b, c = np.array(corners).reshape(-1, 3, 3).swapaxes(0, 1)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_clouds_of_a_flight_get_poses_that_agree_with_each_other(ros, flight):
    poses, stated, seen = flight
    bench = Bench(ros)
    paths = ros.collect(Path, 'survey/path', LATCHED)
    drawn = ros.collect(MarkerArray, 'survey/coverage', LATCHED)
    ros.met_by('survey')
    for number, ((cloud, skin), pose) in enumerate(zip(seen, stated, strict=True)):
        bench.show(number, cloud, skin, pose)
        ros.until(lambda: len(bench.found) > number)  # noqa: B023
    ros.until(lambda: paths and len(paths[-1].poses) == len(poses))
    bench.state.shows('joined', len(poses))
    # As much as the clouds cover of the skin, whose true poses differ by millimetres.
    area = (5 * 0.05 + COLUMNS * SPACING) * ROWS * SPACING
    ros.until(lambda: drawn and _area(drawn[-1]) == pytest.approx(area, rel=0.06))
    assert {marker.ns for marker in drawn[-1].markers} == {'', 'measured'}, 'no gaps'
    assert drawn[-1].markers[1].header.frame_id == 'map'

    stamps = [(number + 1) * HALF_S for number in range(len(poses))]
    assert [stamp_to_ns(each.header.stamp) for each in bench.found] == stamps
    assert {each.header.frame_id for each in bench.found} == {'map'}
    assert [stamp_to_ns(each.header.stamp) for each in paths[-1].poses] == stamps
    path = [pose_from_message(each.pose) for each in paths[-1].poses]
    assert np.abs(steps(stated) - steps(poses)).max() > 0.005
    assert np.abs(steps(path) - steps(poses)).max() < 3e-4
    # In the map all of them err as the autopilot does, and say so.
    newest = bench.found[-1].pose
    covariance = covariance_from_message(newest.covariance)
    off = pose_from_message(newest.pose).translation - poses[-1].translation
    assert off @ np.linalg.solve(covariance[:3, :3], off) / 3 < 4
    assert 0.005 < np.sqrt(covariance[0, 0]) <= np.sqrt(STATED[0, 0]) * 1.001
    assert int(bench.state.value('pairs')) >= len(poses) - 1
    assert bench.state.value('pairs left out') == bench.state.value('pairs without ties') == '0'
    assert float(bench.state.value('computation median (ms)')) > 0
    assert bench.state.value('refused') == bench.state.value('failed') == '0'
    assert bench.process.stop() == 0


def test_what_cannot_be_joined_is_told_with_its_reason_and_ends_nothing(ros, flight):
    _, stated, seen = flight
    bench = Bench(ros)
    (cloud, skin), pose = seen[0], stated[0]
    few = np.full_like(cloud.points, np.nan)
    few[:5, :5] = cloud.points[:5, :5]
    nothing = Pose(pose.rotation, np.array([np.nan, 0.0, 0.0]))
    rough = cloud.points * (1 + 0.01 * np.sin(200 * cloud.points[..., :1]))
    hostile = {
        'already seen': (0, cloud, skin, pose),
        'wrong cloud': (11, Cloud(few, cloud.intensity), skin, pose),
        'wrong pose': (12, cloud, skin, nothing),
        'wrong frame': (13, cloud, skin, pose, STATED, 'odom'),
        # These are joined, as far as they can be.
        'pair not used in full': (14, Cloud(rough, cloud.intensity), skin, pose, np.zeros((6, 6))),
        'wrong skin': (15, cloud, skin[:7], pose),
    }
    bench.show(0, cloud, skin, pose)
    ros.until(lambda: bench.found)
    for number, words in enumerate(hostile.values(), start=1):
        bench.show(*words)
        # A good cloud after it tells when it is done with.
        bench.show(20 + number, *seen[number % 6], stated[number % 6])
        stamp_ns = (21 + number) * HALF_S
        ros.until(lambda: stamp_to_ns(bench.found[-1].header.stamp) == stamp_ns)  # noqa: B023
    bench.state.shows('joined', 9)
    for reason in hostile:
        assert int(bench.state.value(f'refused: {reason}')) >= 1, reason
    assert bench.state.value('clouds without skin') == '1'
    assert bench.state.value('failed') == '0' and bench.state().level == WARN
    assert bench.process.stop() == 0
    assert 'their heights differ' in bench.process.output
