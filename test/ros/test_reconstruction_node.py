from __future__ import annotations

import time
from array import array
from functools import cached_property

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.calibration.rig_check import turned
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig, write_rig
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_from_message,
    image_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import IMAGES, PATTERNS
from ftp_dent_ros.simulation import Panel, Photometry, Renderer, Surface

PATTERN = Pattern(320, 200, 8.0, 160.0)
SECOND = 1_000_000_000
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

    def __init__(self, ros, camera=IMAGES, **parameters):
        self.ros = ros
        parameters = {'pattern_settling': 0.0, **parameters}
        self.process = ros.start('reconstruction', **parameters)
        self.state = ros.diagnostics('reconstruction')
        self.value, self.says = self.state.value, self.state.says
        self.clouds = []
        self.pattern = ros.publisher(Image, 'projector/image_raw', PATTERNS)
        self.camera = ros.publisher(Image, 'camera/image_raw', camera)

    @cached_property
    def info(self):
        return self.ros.publisher(CameraInfo, 'camera/camera_info', IMAGES)

    def listen(self):
        self.clouds = self.ros.collect(PointCloud2, 'points')
        self.says('waiting for images')

    def project(self, pixels, stamp_ns=1):
        self.pattern.publish(image_to_message(pixels, stamp_ns, 'projector_optical_frame'))

    def show(self, pixels, stamp_ns=5):
        self.camera.publish(image_to_message(pixels, stamp_ns, 'eye'))

    @property
    def message(self):
        return self.state.message

    def takes_back(self, words):
        """Wait until the state's message does not begin so any more."""
        self.ros.until(lambda: self.message and not self.message.startswith(words))

    def cloud_of(self, pixels, stamp_ns):
        count = len(self.clouds)
        self.show(pixels, stamp_ns)
        self.ros.until(lambda: len(self.clouds) > count)
        return self.clouds[-1]

    def refused(self, reason):
        """Wait until the log tells of the first refusal for the reason."""
        self.ros.until(lambda: f'refused, {reason}: ' in self.process.output)

    def set(self, **values):
        """Set parameters; results of the service."""
        parameters = [Parameter(key, value=value) for key, value in values.items()]
        request = SetParameters.Request(
            parameters=[item.to_parameter_msg() for item in parameters]
        )
        return self.ros.call(SetParameters, 'reconstruction/set_parameters', request).results


def test_a_photograph_becomes_the_cloud_that_the_library_gives(ros, rig, rig_file, photograph):
    bench = Bench(ros, rig=rig_file, stride=2)
    bench.says('no pattern: nothing came')
    bench.project(PATTERN.draw())
    bench.says('idle: nobody subscribes to points')
    bench.show(photograph)
    bench.state.shows('images', 1)
    assert bench.value('clouds') is None, 'nothing is computed without subscribers'

    bench.clouds = ros.collect(PointCloud2, 'points')
    bench.takes_back('idle')
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
    bench.state.shows('clouds', 2)
    assert bench.state().level == DiagnosticStatus.OK
    assert float(bench.value('computation median (ms)')) > 0
    assert float(bench.value('lit but not tied to the red stripe').rstrip('%')) < 10

    # The skin comes before its cloud to who subscribes.
    skins = ros.collect(Image, 'skin')
    ros.met_by('reconstruction')
    bench.cloud_of(photograph, 7)
    (message,) = ros.until(lambda: skins)
    assert (message.encoding, message.header.frame_id) == ('mono8', 'eye')
    assert stamp_to_ns(message.header.stamp) == 7
    image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
    expected = Reconstructor(rig, PATTERN, Settings(stride=2)).measure(photograph, skin=True)
    np.testing.assert_array_equal(image, expected.cloud.skin)

    # What is not tied to the stripe is left out, and said.
    near = Panel(Pose.from_rpy([0, 0, 0], [0, 0, 0.65]), (-0.2, 0.07, -0.2, 0.2))
    far = Panel(Pose.from_rpy([0, 0, 0], [0, 0, 0.662]), (0.085, 0.25, -0.2, 0.2))
    bench.cloud_of(Renderer(rig, PATTERN.draw(), Photometry()).render(Surface((near, far))), 8)
    ros.until(lambda: 'not tied to the red stripe' in (bench.value('remarks') or ''))
    assert float(bench.value('lit but not tied to the red stripe').rstrip('%')) > 10

    assert all(result.successful for result in bench.set(stride=4, method='direct'))
    changed = bench.cloud_of(photograph, 3)
    direct = Reconstructor(rig, PATTERN, Settings(method='direct', stride=4))
    np.testing.assert_array_equal(
        cloud_from_message(changed).points, direct.reconstruct(photograph).points
    )
    (refused,) = bench.set(tau=0.0)
    assert not refused.successful and 'tau is 0.0' in refused.reason
    (refused,) = bench.set(unwrapping='quality')
    assert not refused.successful and 'give one of itoh, estrada' in refused.reason
    assert bench.cloud_of(photograph, 4).data == changed.data
    assert bench.process.stop() == 0


def test_each_bad_photograph_is_refused_with_its_reason(ros, rig, rig_file, render, photograph):
    bench = Bench(ros, rig=rig_file)
    bench.project(PATTERN.draw())
    bench.says('idle')
    bench.listen()
    grey = np.repeat(PATTERN.draw()[..., :1], 3, axis=2)
    bench.show(render(grey))
    bench.refused('no stripe')
    bench.show(np.zeros_like(photograph))
    bench.refused('too dark')
    bench.show(render(exposure=6.0))
    bench.refused('saturated')
    bench.show(photograph[:-2])
    bench.refused('wrong image')
    bench.state.shows('refused', 4)
    assert bench.state().level == DiagnosticStatus.WARN
    assert bench.message.startswith('4 refused in 10 s, last wrong image: ')
    assert '400x258' in bench.message and '400x260' in bench.message
    for reason in ('no stripe', 'too dark', 'saturated', 'wrong image'):
        assert bench.value(f'refused: {reason}') == '1'
    bench.cloud_of(photograph, 7)

    other = camera_info_message(rig.camera, (400, 260), 1, 'eye')
    other.k[0] *= 1.1
    bench.info.publish(other)
    bench.says("wrong calibration: camera_info differs from the rig's camera by up to 20.0 pixels")
    bench.show(photograph)
    bench.refused('wrong calibration')
    bench.info.publish(camera_info_message(rig.camera, (400, 260), 1, 'eye'))
    bench.takes_back('wrong calibration')
    bench.cloud_of(photograph, 8)

    bench.project(Pattern(640, 400, 16.0, 320.0).draw())
    bench.state.shows('period (px)', 16)
    bench.show(photograph)
    bench.state.shows('refused: wrong pattern', 1)
    assert 'the pattern is 640x400, the projector 320x200' in bench.message
    bench.project(PATTERN.draw())
    bench.cloud_of(photograph, 9)
    # Stamps of the future, and repeated ones.
    for ahead_s in (2, 3600):
        bench.show(photograph, time.time_ns() + ahead_s * SECOND)
    bench.state.shows('refused: wrong stamp', 2)
    assert 's in the future: stamp it with the middle of its exposure' in bench.message
    for _ in range(2):
        bench.show(photograph, 9)
    bench.state.shows('refused: wrong stamp', 4)
    assert 'has the stamp of the one before' in bench.message
    bench.cloud_of(photograph, 10)
    assert (len(bench.clouds), bench.value('failed')) == (4, '0')


def test_without_a_rig_every_photograph_is_refused(ros, photograph):
    bench = Bench(ros)
    bench.project(PATTERN.draw())
    ros.collect(PointCloud2, 'points')
    ros.until(lambda: ros.node.count_publishers('points') == 1)

    def is_refused():
        bench.show(photograph)
        ros.executor.spin_once(timeout_sec=0.1)
        return 'refused, no calibration: ' in bench.process.output

    ros.until(is_refused)
    ros.until(lambda: bench.value('refused: no calibration'))
    assert bench.state().level == DiagnosticStatus.WARN
    assert bench.message == 'no calibration: set the parameter rig to its rig.yaml'
    assert bench.process.stop() == 0


def test_hostile_messages_end_nothing_and_a_flood_is_thinned(ros, rig_file, photograph):
    bench = Bench(ros, rig=rig_file)
    bench.project(PATTERN.draw())
    bench.says('idle')
    bench.listen()
    for change in (
        {'height': 2**32 - 1, 'width': 2**32 - 1, 'step': 2**32 - 1},
        {'encoding': 'rgb8; rm -rf', 'data': array('B')},
    ):
        message = image_to_message(photograph, 1, 'eye')
        for name, value in change.items():
            setattr(message, name, value)
        bench.camera.publish(message)
        bench.refused('wrong image')
    bench.info.publish(
        CameraInfo(width=400, height=260, k=[float('nan')] * 9, d=[float('inf')] * 5)
    )
    bench.refused('wrong camera_info')
    ros.until(lambda: 'ignored: camera_info' in str(bench.value('camera_info')))
    assert 'not finite' in bench.value('camera_info')
    bench.pattern.publish(Image(height=3, width=2**31, step=1, encoding='rgb8'))
    bench.refused('wrong pattern')
    # What is no image tells nothing of what is projected.
    bench.cloud_of(photograph, 4)
    assert bench.value('failed') == '0' and 'Traceback' not in bench.process.output

    sent = 5
    while not bench.value('dropped'):
        bench.show(photograph, sent)
        sent += 1
        ros.executor.spin_once(timeout_sec=0.01)
    bench.show(photograph, 10**9)
    ros.until(lambda: bench.clouds[-1].header.stamp.sec == 1)
    stamps = [stamp_to_ns(cloud.header.stamp) for cloud in bench.clouds]
    assert stamps == sorted(set(stamps)), 'never an older one after a newer one'
    names = ('clouds', 'dropped', 'refused')
    ros.until(
        lambda: (
            all(bench.value(name) for name in names)
            and int(bench.value('clouds')) >= len(bench.clouds)
            # One refusal is of the pattern, one of camera_info.
            and sum(int(bench.value(name)) for name in names) == int(bench.value('images')) + 2
        )
    )
    assert bench.process.stop() == 0


def test_a_photograph_goes_with_the_pattern_shown_when_it_was_taken(ros, rig_file, render):
    other = Pattern(320, 200, 10.0, 160.0)
    of_first, of_other = render(), render(other.draw())
    bench = Bench(ros, rig=rig_file, stride=2, pattern_settling=0.25)
    bench.project(PATTERN.draw(), 1 * SECOND)
    bench.says('idle')
    bench.project(other.draw(), 2 * SECOND)
    ros.until(lambda: bench.process.output.count('pattern with period') == 2)
    bench.listen()

    def is_right(message):
        cloud = cloud_from_message(message)
        return np.abs(SKIN.distance(cloud.points[cloud.valid])).mean() < 0.5e-3

    # In any order, and however late.
    assert is_right(bench.cloud_of(of_other, 10 * SECOND))
    assert is_right(bench.cloud_of(of_first, SECOND + SECOND // 2))
    assert is_right(bench.cloud_of(of_other, 2 * SECOND + SECOND // 4))
    bench.show(of_first, SECOND // 2)
    bench.refused('no pattern')
    for number, (photograph, away_ms) in enumerate(((of_first, -240), (of_other, 240)), start=1):
        bench.show(photograph, 2 * SECOND + away_ms * 1_000_000)
        ros.until(lambda number=number: bench.value('refused: pattern changed') == str(number))
    assert 'the period changed from 8 to 10 px' in bench.message
    assert bench.state().level == DiagnosticStatus.WARN
    assert bench.value('refused: no pattern') == '1'
    # A replay of another flight, from before.
    bench.project(other.draw(), -9 * SECOND)
    bench.project(PATTERN.draw(), -5 * SECOND)
    ros.until(lambda: bench.process.output.count('pattern with period') == 4)
    assert is_right(bench.cloud_of(of_first, -3 * SECOND))
    assert len(bench.clouds) == 4
    assert bench.process.stop() == 0


def test_a_rig_that_has_moved_is_told_by_three_clouds_of_coded_fringes(ros, tmp_path):
    true = read_rig(config_folder() / 'rig.yaml')
    size = true.projector.width, true.projector.height
    pattern = Pattern(*size, 10.0, 640.0, code='contrast')
    skin = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.8]), (-1, 1, -1, 1), 2.0),))
    image = Renderer(true, pattern.draw(), Photometry(samples=4)).render(skin)
    write_rig(tmp_path / 'rig.yaml', turned(true, np.radians([0.05, 0.0, 0.0])))
    bench = Bench(ros, rig=str(tmp_path / 'rig.yaml'), stride=8)
    bench.project(pattern.draw())
    bench.listen()
    for stamp_ns in (1, 2, 3):
        assert not bench.message.startswith('the rig does not hold: light')
        bench.cloud_of(image, stamp_ns * SECOND)
    bench.says('the rig does not hold: light')
    assert 'the cloud is off by' in bench.value('epipolar lines')
    assert float(bench.value('beside epipolar lines (px)')) == pytest.approx(1.66, abs=0.1)
    assert float(bench.value('its uncertainty (px)')) < 0.05
    ros.until(lambda: bench.value('rig check'))
    assert bench.value('rig check').startswith('the rig does not hold: the projector has turned')


BEST_EFFORT = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_a_camera_of_another_make_is_heard_and_what_it_lacks_is_said(
    ros, rig, rig_file, photograph
):
    bench = Bench(ros, BEST_EFFORT, rig=rig_file)
    bench.project(PATTERN.draw())
    bench.clouds = ros.collect(PointCloud2, 'points')
    stamps = iter(range(1, SECOND))
    ros.until(lambda: bench.show(photograph, next(stamps)) or bench.clouds)
    ros.until(lambda: "none came: the rig's own camera" in (bench.value('camera_info') or ''))
    # Once it comes, the warning ends.
    bench.info.publish(camera_info_message(rig.camera, (400, 260), 1, 'eye'))
    bench.state.shows('camera_info', 'comes')
    name = bench.camera.topic_name

    def heard():
        infos = ros.node.get_subscriptions_info_by_topic(name)
        return [ReliabilityPolicy(info.qos_profile.reliability).name for info in infos]

    assert heard() == ['BEST_EFFORT']
    bench.says('camera/image_raw is published with best effort')
    ros.node.destroy_publisher(bench.camera)
    for _ in range(2):
        ros.publisher(Image, 'camera/image_raw', IMAGES)
    ros.until(lambda: heard() == ['RELIABLE'])
    bench.says('camera/image_raw has 2 publishers, whose messages mix')
