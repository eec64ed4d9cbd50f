"""The node as a process: clouds in, dents, list and markers out."""

from __future__ import annotations

import json
import shutil
from array import array
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from bag_samples import topic
from dent_samples import DENTED, noisy_cloud
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.messages import dents_from_message
from ftp_dent_ros.dents.dent_list import EXACT, DentList
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.inspecting import survey_bag
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.records import dent_record
from ftp_dent_ros.nodes.settings import DentInspectorSettings, read
from ftp_dent_ros.pages.words import finite
from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.dent_messages import dents_to_message
from ftp_dent_ros.ros.messages import (
    cloud_to_message,
    covariant_pose_message,
    make_header,
    pose_stamped_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED, POSES
from ftp_dent_ros.simulation.truth import true_dents

CAMERA = 'camera_optical_frame'
CAMERA_POSES = [
    Pose.from_rpy((-1.6, 0.0, -1.5 + turn), (8.0, along, 2.0))
    for turn, along in ((0.0, 3.0), (0.02, 3.02), (-0.01, 2.99))
]


# Of an autopilot that knows its place.
SURE = np.diag([1e-6] * 3 + [1e-8] * 3)


class Bench:
    """An inspecting process, and what comes out of it."""

    def __init__(self, ros, **parameters):
        self.ros = ros
        self.process = ros.start('dent_inspector', **parameters)
        self.state = ros.diagnostics('dent_inspector')
        self.value = self.state.value
        self.points = ros.publisher(PointCloud2, 'points', CLOUDS)
        if parameters.get('source') == 'tagged':
            self.poses = ros.publisher(PoseWithCovarianceStamped, 'tagged/camera_pose', POSES)

    def show(self, cloud, stamp_ns, frame_id=CAMERA):
        self.points.publish(cloud_to_message(cloud, stamp_ns, frame_id))

    def tag(self, stamp_ns, pose, covariance=SURE, frame_id='map'):
        self.poses.publish(covariant_pose_message(pose, covariance, stamp_ns, frame_id))

    def take(self):
        answer = self.ros.call(Trigger, 'dent_inspector/take_list', Trigger.Request())
        assert answer.success
        return json.loads(answer.message)


@pytest.fixture(scope='module')
def cloud():
    return noisy_cloud()


def test_a_cloud_becomes_its_dents_and_nothing_is_computed_unasked(ros, cloud):
    bench = Bench(ros)
    bench.state.says('idle: nobody subscribes')
    bench.show(cloud, 5)
    ros.until(lambda: bench.value('clouds') == '1')
    assert bench.value('inspected') is None
    dents = ros.collect(PointCloud2, 'dents')
    ros.met_by('dent_inspector')
    bench.show(cloud, 1_763_000_000_123_456_789)
    ros.until(lambda: dents)
    (message,) = dents
    assert stamp_to_ns(message.header.stamp) == 1_763_000_000_123_456_789
    assert message.header.frame_id == 'camera_optical_frame'
    values = dents_from_message(message)
    truth = true_dents(DENTED)
    assert len(values) == len(truth)
    np.testing.assert_allclose(values['depth'], [t.depth for t in truth], atol=2e-5)
    np.testing.assert_allclose(values['length'], [t.length for t in truth], atol=1e-3)
    for value, true in zip(values, truth, strict=True):
        np.testing.assert_allclose([value[a] for a in 'xyz'], true.position, atol=5e-4)
        np.testing.assert_allclose([value[f'normal_{a}'] for a in 'xyz'], true.normal, atol=0.01)
    # Who comes late is told the list.
    late = ros.collect(PointCloud2, 'dents/list', LATCHED)
    markers = ros.collect(MarkerArray, 'dents/markers', LATCHED)
    ros.until(lambda: late and markers)
    assert dents_from_message(late[-1])['number'].tolist() == [1, 2]
    assert len(markers[-1].markers) == 5
    assert bench.process.stop() == 0


def test_the_node_lists_what_the_command_does_and_refuses_what_is_wrong(ros, cloud):
    bench = Bench(ros)
    dents = ros.collect(PointCloud2, 'dents')
    ros.met_by('dent_inspector')
    bench.show(cloud, 7)
    ros.until(lambda: dents)
    found = inspect(cloud)
    alone = DentList()
    alone.add(1, [*found.dents, *found.others], IDENTITY, EXACT)
    assert bytes(dents[0].data) == bytes(dents_to_message(alone.entries, 7, CAMERA).data)
    nothing = Cloud(np.full((60, 80, 3), np.nan, np.float32), np.zeros((60, 80), np.float32))
    bench.show(nothing, 8)
    bench.state.shows('refused: wrong cloud', 1)
    bench.show(replace(cloud, resolution=np.full_like(cloud.intensity, 1e12)), 9)
    bench.state.shows('refused: wrong cloud', 2)
    assert 'resolution of 1e+12 m' in bench.state.message
    bench.points.publish(PointCloud2(height=1, width=2, data=array('B', bytes(3))))
    bench.state.shows('refused: wrong cloud', 3)
    assert bench.state().level == DiagnosticStatus.WARN
    bench.show(cloud, 10)
    ros.until(lambda: len(dents) == 2)
    assert bench.value('failed') == '0'
    assert bench.process.stop() == 0


def recorded(folder, messages):
    """A bag of (topic, message), in the order of their arrival."""
    types = {
        '/points': 'sensor_msgs/msg/PointCloud2',
        '/tagged/camera_pose': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    }
    with BagWriter(folder) as writer:
        for name, type_name in types.items():
            writer.add_topic(topic(name, type_name))
        for number, (name, message) in enumerate(messages):
            data = serialize_message(message)
            writer.write([Message(name, types[name], number, number, data)])
    return open_bag(folder)


def test_tagged_clouds_become_one_list_that_the_service_takes(ros, cloud, tmp_path):
    messages = []
    bench = Bench(ros, source='tagged', always=True, rules='shipped:example_rules.yaml')
    for number, pose in enumerate(CAMERA_POSES, start=1):
        seen = noisy_cloud(DENTED.transformed(pose.inverse() @ CAMERA_POSES[0]), number)
        stamped = covariant_pose_message(pose, SURE, number * 10**9, 'map')
        messages += [
            ('/points', cloud_to_message(seen, number * 10**9, CAMERA)),
            ('/tagged/camera_pose', stamped),
        ]
        # Cloud and pose may come in either order.
        parts = [
            lambda: bench.show(seen, number * 10**9),  # noqa: B023
            lambda: bench.poses.publish(stamped),  # noqa: B023
        ]
        for publish in parts if number % 2 else reversed(parts):
            publish()
        bench.state.shows('inspected', number)
    markers = ros.collect(MarkerArray, 'dents/markers', LATCHED)
    listed = ros.collect(PointCloud2, 'dents/list', LATCHED)
    # It is drawn once a second at most.
    ros.until(lambda: listed and dents_from_message(listed[-1])['sightings'].tolist() == [3, 3])
    ros.until(lambda: markers)
    taken = bench.take()
    truth = [CAMERA_POSES[0].apply(true.position) for true in true_dents(DENTED)]
    assert (taken['frame_id'], taken['clouds']) == ('map', 3)
    found = [[dent[axis] for axis in 'xyz'] for dent in taken['dents']]
    np.testing.assert_allclose(found, truth, atol=1e-3)
    assert [dent['sightings'] for dent in taken['dents']] == [3, 3]
    assert [dent['depth_mm'] for dent in taken['dents']] == pytest.approx([2, 1], abs=0.02)
    assert all(dent['verdict'] for dent in taken['dents'])
    # A bag of the same messages has the same dents, to the last bit.
    report = survey_bag(recorded(tmp_path / 'bag', messages), inspect)
    same = [finite(dent_record(entry)) for entry in report.dents]
    judged = ('verdict', 'limits')
    for node, bag in zip(taken['dents'], same, strict=True):
        assert {k: v for k, v in node.items() if k not in judged} == {
            k: v for k, v in bag.items() if k not in judged
        }
    ros.until(lambda: dents_from_message(listed[-1]).size == 0)
    assert bench.take()['dents'] == []
    assert bench.process.stop() == 0


def test_the_survey_places_the_dents_and_corrects_their_list(ros, cloud):
    bench = Bench(ros, source='tagged', always=True)
    surveyed = ros.publisher(PoseWithCovarianceStamped, 'survey/pose', POSES)
    paths = ros.publisher(Path, 'survey/path', LATCHED)
    listed = ros.collect(PointCloud2, 'dents/list', LATCHED)
    # It waits for no pose of a survey that it has not met.
    ros.met_by('dent_inspector')

    def off(pose, *shift):
        return Pose(pose.rotation, pose.translation + shift)

    def places():
        found = dents_from_message(listed[-1])
        return np.stack([found[axis] for axis in 'xyz'], axis=-1)

    truth = [CAMERA_POSES[0].apply(true.position) for true in true_dents(DENTED)]
    for number, pose in enumerate(CAMERA_POSES, start=1):
        seen = noisy_cloud(DENTED.transformed(pose.inverse() @ CAMERA_POSES[0]), number)
        bench.tag(number, off(pose, 0.3, 0, 0), 100 * SURE)
        bench.show(seen, number)
        # The second one is lost, and waits for nothing longer than until the next.
        if number != 2:
            near = off(pose, 0, 0.03, 0)
            surveyed.publish(covariant_pose_message(near, 100 * SURE, number, 'map'))
            bench.state.shows('inspected', number)
    assert bench.value('placed by the survey') == '2'
    ros.until(lambda: len(dents_from_message(listed[-1])) == 4)
    np.testing.assert_allclose(places()[:2], np.add(truth, [0, 0.03, 0]), atol=2e-3)

    def path(shift, frame_id='map', flown=CAMERA_POSES):
        poses = [
            pose_stamped_message(off(pose, *shift), number, 'map')
            for number, pose in enumerate(flown, start=1)
        ]
        return Path(header=make_header(3, frame_id), poses=poses)

    paths.publish(path((0, 0, 0), 'odom'))
    bench.state.shows('refused: wrong frame', 1)
    paths.publish(path((0, 0, 0)))
    # The dents of the lost pose are the others, after all.
    ros.until(lambda: dents_from_message(listed[-1])['sightings'].tolist() == [3, 3])
    np.testing.assert_allclose(places(), truth, atol=1e-3)
    assert dents_from_message(listed[-1])['number'].tolist() == [1, 2]
    # What another frame's path says of a cloud that comes later is not believed either.
    paths.publish(path((9, 0, 0), 'odom', [*CAMERA_POSES, CAMERA_POSES[0]]))
    bench.state.shows('refused: wrong frame', 2)
    surveyed.publish(covariant_pose_message(CAMERA_POSES[0], 100 * SURE, 4, 'map'))
    bench.show(cloud, 4)
    ros.until(lambda: dents_from_message(listed[-1])['sightings'].tolist() == [4, 4])
    assert bench.value('failed') == '0'
    assert bench.process.stop() == 0


def test_what_is_not_plausible_changes_nothing_in_the_list(ros, cloud):
    bench = Bench(ros, source='tagged', always=True)
    listed = ros.collect(PointCloud2, 'dents/list', LATCHED)

    def send(stamp, points, pose, covariance=SURE, frames=(CAMERA, 'map')):
        bench.tag(stamp, pose, covariance, frames[1])
        bench.show(points, stamp, frames[0])

    good, pose = cloud, CAMERA_POSES[0]
    moved = Pose(pose.rotation, np.array([1e300, 0.0, 0.0]))
    nothing = Cloud(np.zeros((60, 80, 3), np.float32), np.zeros((60, 80), np.float32))
    # Nor does a frame of its own make a list of it.
    send(100, good, pose, SURE, (CAMERA, 'odom'))
    bench.state.shows('refused: wrong frame', 1)
    send(1, good, pose)
    ros.until(lambda: bench.value('inspected') == '1' and listed)
    hostile = [
        ('already seen', (1, good, pose)),
        ('wrong pose', (2, good, moved)),
        ('wrong pose', (3, good, pose, -SURE)),
        ('wrong cloud', (8, nothing, pose)),
        ('wrong frame', (9, good, pose, SURE, ('map', 'map'))),
        ('wrong frame', (10, good, pose, SURE, (CAMERA, 'odom'))),
    ]
    refused = Counter({'wrong frame': 1})
    for reason, words in hostile:
        send(*words)
        refused[reason] += 1
        bench.state.shows(f'refused: {reason}', refused[reason])
    send(11, good, pose)
    bench.state.shows('inspected', 2)
    ros.until(lambda: dents_from_message(listed[-1])['sightings'].tolist() == [2, 2])
    assert bench.value('failed') == '0'
    taken = bench.take()
    assert (taken['clouds'], taken['frame_id']) == (2, 'map')
    assert [dent['sightings'] for dent in taken['dents']] == [2, 2]


def test_a_file_for_a_list_that_is_not_kept_is_refused(tmp_path):
    given = {'list_file': str(tmp_path / 'dents.jsonl')}
    tagged = read(DentInspectorSettings, Declarations({**given, 'source': 'tagged'}))
    assert tagged.list_file == given['list_file']
    with pytest.raises(ConfigurationError, match='set source to tagged, or leave list_file out'):
        read(DentInspectorSettings, Declarations(given))


def test_a_list_is_taken_with_all_clouds_before_and_survives_a_restart(ros, cloud, tmp_path):
    kept = tmp_path / 'kept' / 'dents.jsonl'
    given = {'source': 'tagged', 'always': True, 'list_file': str(kept)}
    bench = Bench(ros, **given)
    # Each takes a second or so, and the counts come once a second.
    rays = Lens(960, 720, np.diag([1200.0, 1200, 1]) + 0.0, np.zeros(5))
    rays = rays.rays(rays.pixel_grid() - np.array([479.5, 359.5]))
    points = (rays * DENTED.intersect(rays)[..., None]).astype(np.float32)
    large = Cloud(points, np.ones(points.shape[:2], np.float32))

    def show(bench, seen, *stamps):
        for stamp in stamps:
            bench.tag(stamp, CAMERA_POSES[0])
            bench.show(seen, stamp)

    show(bench, large, 1, 2)
    bench.state.shows('clouds', 2)
    assert bench.take()['clouds'] == 2
    show(bench, large, 3, 4)
    bench.state.shows('clouds', 4)
    assert bench.process.stop() == 0, 'no cloud that came is lost at the end'
    assert len(kept.read_text().splitlines()) == 2
    # As if the power had failed while the next cloud was written.
    kept.write_bytes(kept.read_bytes() + b'{"frame_id": "ma')

    again = Bench(ros, **given)
    listed = ros.collect(PointCloud2, 'dents/list', LATCHED)
    ros.until(lambda: listed)
    assert dents_from_message(listed[-1])['sightings'].tolist() == [2, 2]
    show(again, cloud, 5)
    ros.until(lambda: dents_from_message(listed[-1])['sightings'].tolist() == [3, 3])
    assert again.take()['clouds'] == 3
    assert kept.read_bytes() == b''
    # Where the disk fails the list goes on in memory, and is taken all the same.
    shutil.rmtree(kept.parent)
    show(again, cloud, 6)
    again.state.says('the list is not kept on disk (No such file or directory)')
    assert again.take()['clouds'] == 1
    assert again.process.stop() == 0
