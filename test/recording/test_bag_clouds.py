"""What a bag knows of each cloud, read from real bags without ROS."""

from __future__ import annotations

import numpy as np
import pytest
from bag_samples import (
    CLOUD,
    IMAGE,
    LOCATED,
    SECOND,
    cloud_message,
    data_of,
    image,
    located,
    place,
    string_data,
    topic,
)
from dent_samples import DENTED, noisy_cloud

from ftp_dent_ros.errors import BagError, CloudError
from ftp_dent_ros.inspection.inspecting import survey_bag
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import bag_clouds, count_clouds
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.simulation.truth import true_dents

CAMERA_POSE = Pose.from_rpy((-1.6, 0.1, -1.5), (20.0, -8.0, 3.0))
BASE_POSE = Pose.from_rpy((0.0, 0.1, 0.1), (19.9, -8.0, 3.0))
TYPES = {
    '/camera/image_raw': IMAGE,
    '/points': CLOUD,
    '/tagged/pose': LOCATED,
    '/tagged/points': CLOUD,
    '/skin': IMAGE,
}


def cloud_data(cloud, stamp_ns, frame_id, width=None):
    names = ('x', 'y', 'z', 'intensity')
    return data_of(cloud_message(stamp_ns, frame_id, cloud, names, width), CLOUD)


def image_data(pixels, encoding, stamp_ns=7):
    return data_of(image(stamp_ns, 'eye', pixels, encoding), IMAGE)


def pose_data(stamp_ns, quaternion=BASE_POSE.quaternion, covariance=1e-4):
    pose = place(BASE_POSE.translation, quaternion)
    return located(stamp_ns, pose, np.where(np.eye(6), covariance, 0.0))


def parts(stamp_ns=7, seed=1):
    cloud = noisy_cloud(seed=seed)
    photograph = np.full((240, 320, 3), 80, np.uint8)
    return {
        '/camera/image_raw': image_data(photograph, 'rgb8', stamp_ns),
        '/points': cloud_data(cloud, stamp_ns, 'eye'),
        '/tagged/pose': pose_data(stamp_ns),
        '/tagged/points': cloud_data(cloud.transformed(CAMERA_POSE), stamp_ns, 'map'),
    }


@pytest.fixture
def recorded(tmp_path):
    def record(*contents):
        """A bag of (topic, data) in the order of their arrival, a second apart."""
        folder = tmp_path / f'flight{len(list(tmp_path.iterdir()))}'
        with BagWriter(folder) as writer:
            for number, (name, data) in enumerate(contents):
                writer.add_topic(topic(name, TYPES[name]))
                time_ns = (100 + number) * SECOND
                writer.write([Message(name, TYPES[name], time_ns, time_ns, data)])
        return open_bag(folder)

    return record


def test_a_cloud_whose_pose_is_missing_is_told_of_or_given_without_one(recorded):
    contents = [item for stamp in (7, 8, 9) for item in parts(stamp).items()]
    left = [item for number, item in enumerate(contents) if number != 2]
    bag, skipped = recorded(*left), []
    assert [item.stamp_ns for item in bag_clouds(bag, skipped.append)] == [8, 9]
    assert skipped == ['/tagged/points at 0.000 s: has no pose']
    placed = [each.vehicle is not None for each in bag_clouds(bag, unplaced=True)]
    assert placed == [False, True, True]


def test_the_same_cloud_five_times_is_one(recorded):
    skipped = []
    clouds = list(bag_clouds(recorded(*(5 * list(parts().items()))), skipped.append))
    assert [item.stamp_ns for item in clouds] == [7]
    assert set(skipped) == {
        f'{name} at 0.000 s: is there a second time' for name in ('/tagged/points', '/tagged/pose')
    }


def test_a_tagged_cloud_comes_with_its_pose_and_photograph(recorded):
    (item,) = bag_clouds(recorded(*parts().items()))
    assert (item.stamp_ns, item.frame_id, item.in_camera, item.pose) == (7, 'map', False, None)
    np.testing.assert_allclose(item.vehicle.translation, BASE_POSE.translation)
    assert item.covariance[0, 0] == pytest.approx(1e-4) and item.photograph.shape == (240, 320, 3)


def test_a_cloud_comes_with_the_image_of_its_skin(recorded):
    skin = np.arange(12, dtype=np.uint8).reshape(3, 4)
    (item,) = bag_clouds(recorded(('/skin', image_data(skin, 'mono8')), *parts().items()))
    # One of another size is none of the cloud's.
    assert not item.cloud.skin.any()
    skin = np.arange(item.cloud.valid.size).astype(np.uint8).reshape(item.cloud.valid.shape)
    (item,) = bag_clouds(recorded(('/skin', image_data(skin, 'mono8')), *parts().items()))
    np.testing.assert_array_equal(item.cloud.skin, skin)


@pytest.mark.parametrize('topics', [{'/points'}, {'/tagged/points', '/tagged/pose'}])
def test_dents_are_found_in_whatever_clouds_were_recorded(recorded, topics):
    contents = [(name, content) for name, content in parts().items() if name in topics]
    report = survey_bag(recorded(*contents), inspect)
    assert report.frame_id == ('eye' if topics == {'/points'} else 'map')
    truth = [true.position for true in true_dents(DENTED)]
    if topics != {'/points'}:
        truth = CAMERA_POSE.apply(np.array(truth))
    found = [entry.dent.position for entry in report.dents]
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_clouds_without_poses_are_reported_one_by_one(recorded):
    contents = [(name, content) for k in (1, 2) for name, content in parts(k, k).items()]
    report = survey_bag(recorded(*[each for each in contents if each[0] == '/points']), inspect)
    assert [len(entry.sightings) for entry in report.dents] == [1, 1, 1, 1]
    assert not report.placed
    tagged = survey_bag(recorded(*contents), inspect)
    assert [len(entry.sightings) for entry in tagged.dents] == [2, 2]


def test_a_bag_without_clouds_says_what_is_missing(recorded):
    with pytest.raises(BagError, match='/tagged/points or /points'):
        count_clouds(recorded(('/camera/image_raw', parts()['/camera/image_raw'])))


@pytest.mark.parametrize(
    ('spoilt', 'data', 'said'),
    [
        ('/tagged/points', cloud_data(noisy_cloud(), 8, 'map', width=10**6), 'at 0.000 s'),
        ('/tagged/points', b'\x00\x01\x00\x00short', 'at 106.000 s'),
        ('/tagged/pose', pose_data(8, (np.nan, 0, 0, 1)), 'no pose'),
        ('/tagged/pose', pose_data(8, covariance=np.inf), 'covariance is not finite'),
        ('/tagged/pose', string_data('no pose'), 'the bag is damaged'),
    ],
)
def test_a_message_that_cannot_be_used_costs_its_cloud_alone(recorded, spoilt, data, said):
    second = {**parts(8, 2), spoilt: data}
    names = ('/camera/image_raw', '/tagged/pose', '/tagged/points')
    first = [(name, parts(7)[name]) for name in names]
    # The spoilt message comes last of its own, at 106 s.
    middle = sorted([(name, second[name]) for name in names], key=lambda each: each[0] == spoilt)
    last = [('/camera/image_raw', b''), *[(name, parts(9, 3)[name]) for name in names[1:]]]
    skipped = []
    bag = recorded(('/camera/image_raw', b''), *first, *middle, *last)
    found = list(bag_clouds(bag, skipped.append))
    assert [item.stamp_ns for item in found] == [7, 9]
    assert [item.photograph is None for item in found] == [False, True]
    photograph, cloud_or_pose, _ = skipped
    assert photograph.startswith('/camera/image_raw at 100.000 s: ')
    assert cloud_or_pose.startswith(spoilt) and said in cloud_or_pose


def test_the_report_names_what_it_had_to_leave_out(recorded):
    bad = ('/points', cloud_data(noisy_cloud(), 5 * SECOND, 'eye', width=10**6))
    report = survey_bag(recorded(bad, ('/points', parts()['/points'])), inspect)
    assert len(report.frames) == 1 and len(report.skipped) == 1
    assert report.skipped[0].startswith('/points at 5.000 s: the point cloud of 1000000x')
    with pytest.raises(CloudError, match=r'could be inspected .*/points at 5.000 s'):
        survey_bag(recorded(bad), inspect)
