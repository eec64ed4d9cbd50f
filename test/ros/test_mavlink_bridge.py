"""The bridge as a process between a real topic and a real MAVLink link."""

from __future__ import annotations

import signal
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from hovering_autopilot import HoveringAutopilot, Wire
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rclpy.clock import Clock
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.files import find
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_from_message,
    cloud_to_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED, POSES

CAMERA = 'camera_optical_frame'
# Hovering with the nose north 3 m north, 2 m east and 1 m above the origin.
BASE = [2.0, 3.0, 1.0]


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


@pytest.fixture
def autopilot(port: int) -> Iterator[HoveringAutopilot]:
    with hovering(port) as instance:
        yield instance


def hovering(port: int, **options) -> HoveringAutopilot:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(('127.0.0.1', 0))
    return HoveringAutopilot(Wire(end, ('127.0.0.1', port)), **options)


class Bridge:
    """The node's process and all that it publishes."""

    def __init__(self, ros, port: int, **parameters) -> None:
        self.ros = ros
        self.process = ros.start('mavlink_bridge', address=f'udpin:127.0.0.1:{port}', **parameters)
        self.stream = ros.collect(PoseStamped, 'mavlink/pose', POSES)
        self.poses = ros.collect(PoseWithCovarianceStamped, 'tagged/pose', POSES)
        self.cameras = ros.collect(PoseWithCovarianceStamped, 'tagged/camera_pose', POSES)
        self.status = ros.diagnostics('mavlink_bridge')
        self.value = self.status.value
        self.points = ros.publisher(PointCloud2, 'points', CLOUDS)

    def publish(self, frame: str = 'camera_optical_frame', ago: float = 0.1) -> int:
        """Publish a cloud of two points taken some seconds ago; its stamp."""
        points = np.array([[[0.2, 0.3, 1.0], [np.nan] * 3]], np.float32)
        cloud = Cloud(points, np.array([[7.0, 0.0]], np.float32))
        stamp = Clock().now().nanoseconds - round(ago * 1e9)
        self.points.publish(cloud_to_message(cloud, stamp, frame))
        return stamp

    def tag(self, frame: str = 'camera_optical_frame') -> None:
        """Publish until one more cloud has its pose: a busy machine's link has gaps."""
        count = len(self.poses)
        self._publish_until(lambda: len(self.poses) > count, frame)

    def refuse(self, reason: str) -> None:
        """Publish until one more cloud is refused for that."""
        count = self.number(f'refused: {reason}')
        self._publish_until(lambda: self.number(f'refused: {reason}') > count)

    def _publish_until(self, condition: Callable[[], bool], *arguments: Any) -> None:
        due = 0.0
        self.ros.met_by('mavlink_bridge')

        def is_reached() -> bool:
            nonlocal due
            if not condition() and time.monotonic() > due:
                due = time.monotonic() + 2.0
                self.publish(*arguments)
            return condition()

        self.ros.until(is_reached)

    def number(self, key: str) -> float:
        value = self.value(key)
        return 0.0 if value in (None, 'unknown') else float(value)


def test_a_cloud_comes_back_in_the_map_with_the_pose_at_its_stamp(ros, port, autopilot) -> None:
    bridge = Bridge(ros, port, earth=True)
    clouds = ros.collect(PointCloud2, 'tagged/points', CLOUDS)
    ros.until(lambda: bridge.stream)
    for _ in range(3):
        bridge.tag()
    ros.until(lambda: stamps_of(clouds) == stamps_of(bridge.poses) == stamps_of(bridge.cameras))
    assert len(clouds) == len(bridge.poses) == len(bridge.cameras)
    assert {cloud.header.frame_id for cloud in clouds} == {'map'}
    cloud = cloud_from_message(clouds[0])
    # The camera is 10 cm ahead of the body and looks north: right is east, down is down.
    assert_allclose(cloud.points[0, 0], [2.0 + 0.2, 3.0 + 0.1 + 1.0, 1.0 - 0.3], atol=1e-6)
    assert np.isnan(cloud.points[0, 1]).all()
    assert cloud.intensity.tolist() == [[7.0, 0.0]]

    assert {pose.header.frame_id for pose in bridge.poses} == {'map'}
    pose = pose_from_message(bridge.poses[0].pose.pose)
    assert_allclose(pose.translation, BASE, atol=1e-6)
    assert_allclose(pose.rotation.apply([1, 0, 0]), [0, 1, 0], atol=1e-6)
    # A still vehicle with a content estimator.
    covariance = np.reshape(bridge.poses[0].pose.covariance, (6, 6))
    deviations = np.sqrt(np.diag(covariance))
    height = np.hypot(0.05, 0.04 * BASE[2])  # the barometer's scale
    # On a busy machine samples and fixes are further apart, and the tag is wider by that.
    assert_allclose(deviations[:3], [0.03, 0.03, height], rtol=0.3)
    assert_allclose(deviations[3:], np.radians([0.5, 0.5, 1]), rtol=0.3)
    assert_allclose(covariance, np.diag(np.diag(covariance)), atol=1e-12)
    # The camera's, 10 cm ahead: a turn of the vehicle moves it sideways.
    assert {camera.header.frame_id for camera in bridge.cameras} == {'map'}
    camera = pose_from_message(bridge.cameras[0].pose.pose)
    assert_allclose(camera.translation, [BASE[0], BASE[1] + 0.1, BASE[2]], atol=1e-6)
    assert_allclose(camera.rotation.apply([0, 0, 1]), [0, 1, 0], atol=1e-6)
    across = np.sqrt(bridge.cameras[0].pose.covariance[0])
    carried = np.hypot(0.1 * deviations[5], 0.005)  # its lever, and its mount
    assert across == pytest.approx(np.hypot(deviations[0], carried), rel=1e-3)

    ros.until(lambda: len(bridge.stream) > 30)
    live = bridge.stream[-1]
    assert live.header.frame_id == 'map'
    assert_allclose(pose_from_message(live.pose).translation, BASE, atol=1e-6)
    spacing = np.diff([stamp_to_ns(pose.header.stamp) for pose in bridge.stream])
    assert np.median(spacing) == pytest.approx(20e6, abs=2e6)

    origins = ros.collect(NavSatFix, 'earth', LATCHED)
    ros.until(lambda: origins)
    assert (origins[0].header.frame_id, origins[0].latitude) == ('map', pytest.approx(47.45))
    assert origins[0].longitude == pytest.approx(8.56)
    assert np.isnan(origins[0].altitude)  # what it said is above the sea

    ros.until(lambda: bridge.number('tagged') == len(bridge.poses))
    assert 30 <= bridge.number('camera within, across (mm)') < 40
    assert 64 <= bridge.number('camera within, up (mm)') < 75
    assert bridge.value('GPS fix') == '3d fix'
    assert bridge.value('system/component') == '1/1'
    assert bridge.value('clock converged') == 'true'
    assert bridge.number('ATTITUDE_QUATERNION (Hz)') > 0
    ros.until(lambda: 0 < bridge.number('round trip (ms)') < 1000)
    ros.until(lambda: 0 < bridge.number('pose age (ms)') < 1000)
    assert 'waited median (ms)' in {v.key for v in bridge.status().values}
    beats = ros.until(lambda: autopilot.heard('HEARTBEAT'))
    assert {(m.get_srcSystem(), m.get_srcComponent(), m.type) for m in beats} == {
        (1, 191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    }


def test_what_cannot_be_tagged_is_refused_with_its_reason(ros, port, autopilot) -> None:
    bridge = Bridge(ros, port)
    ros.until(lambda: bridge.stream)
    for count, refused in enumerate(({'frame': 'camera_link'}, {'ago': 3600}, {'ago': -3600})):
        bridge.publish(**refused)
        ros.until(lambda n=count: bridge.number('refused') > n)
    for reason in ('wrong frame', 'too old', 'stamp in the future'):
        assert bridge.value(f'refused: {reason}') == '1'
    assert 'no pose for the cloud' in bridge.process.output
    assert bridge.poses == []
    bridge.tag()
    # Without GPS no cloud is tagged.
    autopilot.fix_type = 1
    bridge.status.shows('GPS fix', 'no fix')
    ros.until(lambda: 'GPS has no fix' in bridge.status.message)
    lost = Clock().now().nanoseconds
    bridge.refuse('GPS lost')
    assert max(stamps_of(bridge.poses)) < lost
    autopilot.fix_type = 3
    bridge.status.shows('GPS fix', '3d fix')
    bridge.tag()
    # A map that moves is told also where nobody asks for the earth.
    autopilot.say_origin(474_501_000)
    bridge.status.shows('refused: moved map', 1)
    assert "the map's origin has moved by 11.1" in bridge.process.output
    assert 'do not lie together' in bridge.process.output
    # It ends amid the traffic, and gives its port back.
    assert bridge.process.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in bridge.process.output
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(('127.0.0.1', port))


def test_mount_and_frames_are_parameters_and_clouds_wait_in_a_queue(ros, port) -> None:
    bridge = Bridge(
        ros,
        port,
        mount__translation='[0.0, 0.0, -0.5]',
        mount__rpy='[0.0, 0.0, 0.0]',
        map_frame='site',
        camera_frame='lens',
        pose_timeout=30.0,
        queue_size=2,
    )
    clouds = ros.collect(PointCloud2, 'tagged/points', CLOUDS)
    for count in range(3):
        bridge.publish('lens', ago=0.0)
        ros.until(lambda n=count: bridge.number('clouds') > n)
    # The queue is full, but the cause is another.
    assert bridge.value('refused: no autopilot') == '1'
    assert 'no autopilot has been heard' in bridge.process.output
    assert bridge.value('clouds waiting') == '2'
    with hovering(port):
        ros.until(lambda: bridge.stream)
        # Those that waited are of a time when no autopilot was there.
        bridge.status.shows('refused: GPS not reported', 2)
        bridge.tag('lens')
        ros.until(lambda: clouds)
    assert clouds[0].header.frame_id == bridge.poses[0].header.frame_id == 'site'
    # Mounted as the body is, half a metre below: x is north, y is west.
    assert_allclose(
        cloud_from_message(clouds[0]).points[0, 0], [2.0 - 0.3, 3.0 + 0.2, 0.5 + 1.0], atol=1e-6
    )


def test_clouds_that_get_their_poses_at_once_are_all_published_with_them(
    ros, port, autopilot
) -> None:
    bridge = Bridge(ros, port, pose_timeout=10.0, queue_size=8, maximum_gap=1.0)
    clouds = ros.collect(PointCloud2, 'tagged/points', QoSProfile(depth=20))
    previews = ros.collect(PointCloud2, 'tagged/preview', CLOUDS)
    ros.until(lambda: bridge.stream)
    ros.met_by('mavlink_bridge')
    points = np.random.default_rng(1).uniform(0.5, 1.0, (360, 640, 3)).astype(np.float32)
    cloud = Cloud(points, np.ones((360, 640), np.float32))
    published = 0
    while len(bridge.poses) <= 12:
        autopilot.reports = False  # until it reports again all of them wait
        for _ in range(6):
            stamp = Clock().now().nanoseconds
            bridge.points.publish(cloud_to_message(cloud, stamp, 'camera_optical_frame'))
            ros.executor.spin_once(0.05)
        autopilot.reports = True
        published += 6
        # A busy machine's link has gaps, for which clouds are refused.
        ros.until(lambda: len(bridge.poses) + bridge.number('refused') >= published)  # noqa: B023
    ros.until(lambda: stamps_of(clouds) == stamps_of(bridge.poses) == stamps_of(bridge.cameras))
    ros.until(lambda: stamps_of(previews) & stamps_of(clouds))
    whole, few = (
        cloud_from_message({stamp_to_ns(m.header.stamp): m for m in each}[stamp])
        for stamp in [max(stamps_of(previews) & stamps_of(clouds))]
        for each in (clouds, previews)
    )
    np.testing.assert_array_equal(few.points, whole.points[::2, ::2])


def stamps_of(messages: list) -> set[int]:
    return {stamp_to_ns(message.header.stamp) for message in messages}


def test_a_node_that_stood_still_gets_its_clouds_again(ros, port, autopilot) -> None:
    bridge = Bridge(ros, port, pose_timeout=0.2)
    y, x = np.mgrid[:360, :640].astype(np.float32) / 1000
    cloud = Cloud(np.dstack([x, y, np.ones_like(x)]), np.zeros_like(x))
    message = cloud_to_message(cloud, 0, 'camera_optical_frame')
    due = 0.0

    def is_tagged_after(stamp_ns: int) -> bool:
        """Publish a cloud now and then; whether one that was taken later has its pose."""
        nonlocal due
        if time.monotonic() > due:
            due = time.monotonic() + 0.5
            message.header.stamp = Clock().now().to_msg()
            bridge.points.publish(message)
        return max(stamps_of(bridge.poses), default=0) > stamp_ns

    ros.until(lambda: is_tagged_after(0))
    bridge.process.send(signal.SIGSTOP)
    on = time.monotonic() + 6.0  # several times what Fast DDS waits for a reader
    ros.until(lambda: is_tagged_after(0) and time.monotonic() > on)
    bridge.process.send(signal.SIGCONT)
    now_ns = Clock().now().nanoseconds
    ros.until(lambda: is_tagged_after(now_ns), timeout=30.0)


def test_the_ground_station_takes_photographs_where_that_is_enabled(ros, port, autopilot) -> None:
    Bridge(ros, port, camera__enabled=True, rig='shipped:rig.yaml')
    shots, broken = [], []

    def shoot(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if broken:
            return response
        stamp = Clock().now().nanoseconds
        shots.append(stamp)
        info.publish(camera_info_message(None, (640, 480), stamp, 'camera_optical_frame'))
        response.success = True
        return response

    ros.node.create_service(Trigger, 'camera_capture/capture', shoot)
    info = ros.publisher(CameraInfo, 'camera/camera_info', IMAGES)

    def said(name: str) -> list:
        return [m for m in autopilot.heard(name) if m.get_srcComponent() == 100]

    def command(
        number: int, *parameters: float, sender: tuple[int, int] = (255, 190), to: tuple = (1, 100)
    ) -> None:
        padded = [*parameters, *(7 - len(parameters)) * [0]]
        message = mavlink.MAVLink_command_long_message(*to, number, 0, *padded)
        autopilot.forward(message, *sender)

    ros.until(lambda: {m.type for m in said('HEARTBEAT')} == {mavlink.MAV_TYPE_CAMERA})
    capture = mavlink.MAV_CMD_IMAGE_START_CAPTURE
    command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION)
    information = ros.until(lambda: said('CAMERA_INFORMATION'))[0]
    camera = read_rig(find('shipped:rig.yaml')).camera
    assert (information.resolution_h, information.resolution_v) == (camera.width, camera.height)
    command(capture, 0, 0, 1, 1, sender=(7, 190))  # a stranger
    command(capture, 0, 0, 1, 1, sender=(7, 190), to=(0, 0))
    ros.until(lambda: shots or command(capture, 0, 0, 1, 5) or ros.executor.spin_once(0.3))
    captured = ros.until(lambda: said('CAMERA_IMAGE_CAPTURED'))[0]
    assert captured.time_utc == shots[0] // 1000
    # 10 cm in front of the vehicle, which is 3 m north and 2 m east of the origin, 1 m up.
    assert 1e-7 * captured.lat == pytest.approx(47.45 + 3.1 / 111_180, abs=1e-7)
    assert (captured.alt, captured.relative_alt) == (431_000, 1000)
    assert_allclose(captured.q, [1, 0, 0, 0], atol=1e-6)
    # Its image is of another size than the rig says: that is told unasked.
    ros.until(lambda: said('CAMERA_INFORMATION')[-1].resolution_h == 640)
    acks = {(m.command, m.result, m.target_system) for m in said('COMMAND_ACK')}
    accepted = mavlink.MAV_RESULT_ACCEPTED
    assert {(capture, accepted, 255), (mavlink.MAV_CMD_REQUEST_MESSAGE, accepted, 255)} <= acks
    assert 7 not in {system for _, _, system in acks}
    assert len(shots) == 1
    # As ArduPilot's own driver sends it: to no system and no component.
    command(capture, 0, 0, 1, 1, sender=(1, 1), to=(0, 0))
    ros.until(lambda: len(said('CAMERA_IMAGE_CAPTURED')) == 2)
    assert len(shots) == 2
    # A photograph that could not be taken is told, too.
    broken.append(True)
    command(capture, 0, 0, 1, 9)
    ros.until(lambda: len(said('CAMERA_IMAGE_CAPTURED')) == 3)
    assert [each.capture_result for each in said('CAMERA_IMAGE_CAPTURED')] == [1, 1, 0]


def test_transforms_are_published_where_tf_is_installed(ros, port, autopilot) -> None:
    tf2_msgs = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is not installed: no /tf')
    moving = ros.collect(tf2_msgs.TFMessage, '/tf')
    fixed = ros.collect(tf2_msgs.TFMessage, '/tf_static', LATCHED)
    Bridge(ros, port)
    ros.until(lambda: fixed and moving)
    for messages, frames in ((moving, ('map', 'base_link')), (fixed, ('base_link', CAMERA))):
        (transform,) = messages[0].transforms
        assert (transform.header.frame_id, transform.child_frame_id) == frames
    at, turn = transform.transform.translation, transform.transform.rotation
    mount = Pose.from_quaternion([turn.x, turn.y, turn.z, turn.w], [at.x, at.y, at.z])
    assert_allclose(mount.apply([0.2, 0.3, 1.0]), [1.1, -0.2, -0.3], atol=1e-9)
