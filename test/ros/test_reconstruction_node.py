from __future__ import annotations

from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_from_message,
    image_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED
from ftp_dent_ros.simulation import Panel, Photometry, Renderer, Surface

PATTERN = Pattern(320, 200, 8.0, 160.0)
SKIN = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.65]), (-1, 1, -1, 1), 2.0),))


@pytest.fixture(scope='module')
def render(rig):
    """Function that photographs a curved skin under a pattern's pixels."""

    def photograph(projected=None, **photometry):
        projected = PATTERN.draw() if projected is None else projected
        return Renderer(rig, projected, Photometry(**photometry)).render(SKIN)

    return photograph


@pytest.fixture(scope='module')
def photograph(render):
    return render()


class Bench:
    """A reconstruction process with everything that it needs, and what comes out of it."""

    def __init__(self, ros, listen=True, **parameters):
        self.ros = ros
        self.process = ros.start('reconstruction', **parameters)
        self.state = ros.diagnostics('reconstruction')
        self.clouds = ros.collect(PointCloud2, 'points', CLOUDS) if listen else []
        self.pattern = ros.publisher(Image, 'projector/image_raw', LATCHED)
        self.camera = ros.publisher(Image, 'camera/image_raw', IMAGES)
        self.info = ros.publisher(CameraInfo, 'camera/camera_info', IMAGES)
        self.project(PATTERN.draw())
        if listen:
            ros.until(lambda: ros.node.count_publishers('points') == 1)
        ros.until(lambda: self.value('period (px)') or self.message.startswith('no calibration'))

    def project(self, pixels):
        self.pattern.publish(image_to_message(pixels, 1, 'projector_optical_frame'))

    def show(self, pixels, stamp_ns=5):
        self.camera.publish(image_to_message(pixels, stamp_ns, 'eye'))

    @property
    def message(self):
        return self.state().message if self.state() else ''

    def value(self, key):
        return (
            next((item.value for item in self.state().values if item.key == key), None)
            if (self.state())
            else None
        )

    def cloud_of(self, pixels, stamp_ns):
        count = len(self.clouds)
        self.show(pixels, stamp_ns)
        self.ros.until(lambda: len(self.clouds) > count)
        return self.clouds[-1]

    def refused(self, reason):
        """Wait until the log tells of the first refusal for the reason."""
        self.ros.until(lambda: f'refused, {reason}: ' in self.process.output)


def test_a_photograph_becomes_the_cloud_that_the_library_gives(ros, rig, rig_file, photograph):
    bench = Bench(ros, rig=rig_file, stride=2)
    message = bench.cloud_of(photograph, 1_763_000_000_123_456_789)
    assert stamp_to_ns(message.header.stamp) == 1_763_000_000_123_456_789
    assert message.header.frame_id == 'eye'
    assert (message.height, message.width, message.is_dense) == (130, 200, False)
    cloud = cloud_from_message(message)
    expected = Reconstructor(rig, PATTERN, Settings(stride=2)).reconstruct(photograph)
    np.testing.assert_array_equal(cloud.points, expected.points)
    np.testing.assert_array_equal(cloud.intensity, expected.intensity)
    assert cloud.valid.mean() > 0.8
    assert np.abs(SKIN.distance(cloud.points[cloud.valid])).mean() < 0.2e-3
    again = bench.cloud_of(photograph, 2)
    assert again.data == message.data, 'the same image gives the same cloud, bit for bit'
    ros.until(lambda: bench.value('clouds') == '2')
    assert bench.state().level == DiagnosticStatus.OK
    assert float(bench.value('computation median (ms)')) > 0
    assert bench.process.stop() == 0


def test_each_bad_photograph_is_refused_with_its_reason(ros, rig_file, render, photograph):
    bench = Bench(ros, rig=rig_file)
    grey = np.repeat(PATTERN.draw()[..., :1], 3, axis=2)
    bench.show(render(grey))
    bench.refused('no stripe')
    bench.show(np.zeros_like(photograph))
    bench.refused('too dark')
    bench.show(render(exposure=6.0))
    bench.refused('saturated')
    bench.show(photograph[:-2])
    bench.refused('wrong image')
    ros.until(lambda: bench.value('refused') == '4')
    assert bench.state().level == DiagnosticStatus.WARN
    assert bench.message.startswith('4 refused in 10 s, last wrong image: ')
    assert '400x258' in bench.message and '400x260' in bench.message
    for reason in ('no stripe', 'too dark', 'saturated', 'wrong image'):
        assert bench.value(f'refused: {reason}') == '1'
    assert bench.value('failed') == '0'
    bench.cloud_of(photograph, 7)
    assert len(bench.clouds) == 1


def test_without_a_rig_every_photograph_is_refused(ros, photograph):
    bench = Bench(ros)
    bench.show(photograph)
    bench.refused('no calibration')
    ros.until(lambda: bench.value('refused: no calibration') == '1')
    assert bench.state().level == DiagnosticStatus.WARN
    assert bench.message == 'no calibration: set the parameter rig to its rig.yaml'
    assert bench.process.alive and not bench.clouds


def test_hostile_messages_end_nothing(ros, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)
    good = image_to_message(photograph, 1, 'eye')
    hostile = (
        {'height': 0, 'width': 0, 'step': 0, 'data': array('B')},
        {'data': array('B', bytes(10))},
        {'height': 2**32 - 1, 'width': 2**32 - 1, 'step': 2**32 - 1},
        {'encoding': 'rgb8; rm -rf', 'data': array('B')},
        {'step': 1},
        {'is_bigendian': 255, 'width': 401},
    )
    for change in hostile:
        message = image_to_message(photograph, 1, 'eye')
        for name, value in change.items():
            setattr(message, name, value)
        bench.camera.publish(message)
        bench.refused('wrong image')
    broken = CameraInfo(width=400, height=260, k=[float('nan')] * 9, d=[float('inf')] * 5)
    bench.info.publish(broken)
    bench.ros.until(lambda: 'not finite' in bench.message)
    bench.camera.publish(good)
    bench.refused('wrong calibration')
    bench.info.publish(CameraInfo(width=400, height=260))
    bench.cloud_of(photograph, 3)
    bench.pattern.publish(Image(height=3, width=2**31, step=1, encoding='rgb8'))
    bench.ros.until(lambda: bench.message.startswith('no pattern'))
    bench.show(photograph)
    bench.refused('no pattern')
    bench.project(PATTERN.draw())
    bench.cloud_of(photograph, 4)
    assert bench.value('failed') == '0' and 'Traceback' not in bench.process.output
    assert bench.process.stop() == 0


def test_camera_info_of_another_camera_is_noticed(ros, rig, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)
    own = camera_info_message(rig.camera, (400, 260), 1, 'eye')
    other = camera_info_message(rig.camera, (400, 260), 1, 'eye')
    other.k[0] *= 1.1
    bench.info.publish(other)
    ros.until(lambda: 'wrong calibration' in bench.message)
    assert "differs from the rig's camera by up to 20.0 pixels" in bench.message
    bench.show(photograph)
    bench.refused('wrong calibration')
    other.width = 800
    bench.info.publish(other)
    ros.until(lambda: 'camera_info says 800x260 pixels' in bench.message)
    bench.info.publish(own)
    ros.until(lambda: 'wrong calibration: ' not in bench.message.split(' last ')[0])
    bench.cloud_of(photograph, 3)


def test_nothing_is_computed_without_subscribers(ros, rig_file, photograph):
    bench = Bench(ros, rig=rig_file, listen=False)
    for stamp in range(3):
        bench.show(photograph, stamp)
        ros.until(lambda stamp=stamp: bench.value('images') == str(stamp + 1))
    assert bench.message == 'idle: nobody subscribes to points'
    assert bench.value('clouds') is None


def test_frames_are_dropped_rather_than_queued(ros, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)
    sent = 0
    while not bench.value('dropped'):
        bench.show(photograph, sent)
        sent += 1
        ros.executor.spin_once(timeout_sec=0.01)
    bench.show(photograph, 10**9)
    ros.until(lambda: bench.clouds and bench.clouds[-1].header.stamp.sec == 1)
    stamps = [stamp_to_ns(cloud.header.stamp) for cloud in bench.clouds]
    assert stamps == sorted(set(stamps))
    taken = int(bench.value('images'))
    ros.until(
        lambda: (
            int(bench.value('clouds')) + int(bench.value('dropped')) == int(bench.value('images'))
            and int(bench.value('images')) >= taken
        )
    )


def test_the_method_changes_while_it_runs(ros, rig, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)

    def change(**values):
        parameters = [Parameter(key, value=value) for key, value in values.items()]
        request = SetParameters.Request(
            parameters=[item.to_parameter_msg() for item in parameters]
        )
        return ros.call(SetParameters, 'reconstruction/set_parameters', request).results

    assert bench.cloud_of(photograph, 1).width == 400
    assert all(result.successful for result in change(stride=4, method='direct'))
    message = bench.cloud_of(photograph, 2)
    expected = Reconstructor(rig, PATTERN, Settings(method='direct', stride=4))
    np.testing.assert_array_equal(
        cloud_from_message(message).points, expected.reconstruct(photograph).points
    )
    (refused,) = change(tau=0.0)
    assert not refused.successful and 'tau is 0.0' in refused.reason
    (refused,) = change(unwrapping='quality')
    assert not refused.successful and 'give itoh or estrada' in refused.reason
    assert bench.cloud_of(photograph, 3).data == message.data


def test_the_pattern_of_another_projector_is_refused(ros, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)
    bench.project(Pattern(640, 400, 16.0, 320.0).draw())
    ros.until(lambda: bench.value('period (px)') == '16')
    bench.show(photograph)
    bench.refused('wrong pattern')
    assert 'the pattern is 640x400, the projector 320x200' in bench.process.output
