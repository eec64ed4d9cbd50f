"""What a bag knows of each cloud."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from dent_samples import DENTED, noisy_cloud
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped
from rclpy.serialization import serialize_message

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.inspection.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.bag_clouds import bag_clouds, count_clouds, pose_between
from ftp_dent_ros.ros.bag_survey import survey_bag
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    image_to_message,
    make_header,
    pose_to_message,
)
from ftp_dent_ros.simulation.truth import true_dents

CAMERA_POSE = Pose.from_rpy((-1.6, 0.1, -1.5), (20.0, -8.0, 3.0))
BASE_POSE = Pose.from_rpy((0.0, 0.1, 0.1), (19.9, -8.0, 3.0))


class Bag:
    """A bag in memory: messages of (topic, content) in the order of their arrival."""

    path = Path('flight')

    def __init__(self, *contents):
        self._contents = contents
        counts = Counter(topic for topic, _ in contents)
        self.metadata = SimpleNamespace(message_counts=dict(counts))

    def messages(self, topics):
        for topic, content in self._contents:
            if topic in topics:
                yield SimpleNamespace(topic=topic, data=serialize_message(content))


def parts(stamp_ns=7, seed=1):
    cloud = noisy_cloud(seed=seed)
    pose = PoseWithCovariance(pose=pose_to_message(BASE_POSE), covariance=[1e-4] + [0.0] * 35)
    image = np.full((240, 320, 3), 80, np.uint8)
    return {
        '/camera/image_raw': image_to_message(image, stamp_ns, 'eye'),
        '/points': cloud_to_message(cloud, stamp_ns, 'eye'),
        '/tagged/pose': PoseWithCovarianceStamped(header=make_header(stamp_ns, 'map'), pose=pose),
        '/tagged/points': cloud_to_message(cloud.transformed(CAMERA_POSE), stamp_ns, 'map'),
    }


def test_a_tagged_cloud_comes_with_its_pose_photograph_and_the_cameras_place():
    (item,) = bag_clouds(Bag(*parts().items()))
    assert (item.stamp_ns, item.frame_id, item.in_camera) == (7, 'map', True)
    np.testing.assert_allclose(item.pose.translation, CAMERA_POSE.translation, atol=2e-5)
    turned = (item.pose.rotation.inv() * CAMERA_POSE.rotation).magnitude()
    assert turned < 1e-5
    np.testing.assert_allclose(item.vehicle.translation, BASE_POSE.translation)
    assert item.covariance[0, 0] == 1e-4 and item.photograph.shape == (240, 320, 3)


@pytest.mark.parametrize('recorded', [{'/points'}, {'/tagged/points', '/tagged/pose'}])
def test_dents_are_found_in_whatever_clouds_were_recorded(recorded):
    contents = [(topic, content) for topic, content in parts().items() if topic in recorded]
    report = survey_bag(Bag(*contents), inspect)
    assert report.frame_id == ('eye' if recorded == {'/points'} else 'map')
    truth = [true.position for true in true_dents(DENTED)]
    if recorded != {'/points'}:
        truth = CAMERA_POSE.apply(np.array(truth))
    found = [entry.dent.position for entry in report.dents]
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_clouds_without_poses_are_reported_one_by_one():
    contents = [(topic, content) for k in (1, 2) for topic, content in parts(k, k).items()]
    report = survey_bag(Bag(*[each for each in contents if each[0] == '/points']), inspect)
    assert [len(entry.sightings) for entry in report.dents] == [1, 1, 1, 1]
    assert not report.placed and report.gauges == ()
    tagged = survey_bag(Bag(*contents), inspect)
    assert [len(entry.sightings) for entry in tagged.dents] == [2, 2]
    assert {gauge.quantity for gauge in tagged.gauges} == {'depth', 'length', 'width'}


def test_a_bag_without_clouds_says_what_is_missing():
    with pytest.raises(BagError, match='/tagged/points or /points'):
        count_clouds(Bag(('/camera/image_raw', parts()['/camera/image_raw'])))


def test_clouds_that_are_not_the_same_give_no_pose():
    cloud = noisy_cloud()
    larger = Cloud(cloud.points * np.float32(1.01), cloud.intensity)
    assert pose_between(cloud, larger) is None
    half = Cloud(cloud.points[::2], cloud.intensity[::2])
    assert pose_between(cloud, half) is None
